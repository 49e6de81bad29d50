"""Guide a robot: the guidance node, and beside it a recorder, a page or RViz if wanted.

`ros2 launch cmpsp_ros guidance.launch.py params_file:=my_course.yaml record:=my_bag rviz:=true`
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import (
    LaunchConfiguration,
    NotEqualsSubstitution,
    PathJoinSubstitution,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

CONFIG = PathJoinSubstitution([FindPackageShare('cmpsp_ros'), 'config'])

ARGUMENTS = (
    DeclareLaunchArgument('namespace', default_value='', description='Of all nodes, as in r1.'),
    DeclareLaunchArgument(
        'use_sim_time', default_value='false', description='Whether time comes from /clock.'
    ),
    DeclareLaunchArgument(
        'params_file',
        default_value=PathJoinSubstitution([CONFIG, 'case3.yaml']),
        description='Parameters of course and robot.',
    ),
    DeclareLaunchArgument(
        'robot_file',
        # Twice the same file is the file.
        default_value=LaunchConfiguration('params_file'),
        description='Parameters of the robot, which count before those of params_file.',
    ),
    DeclareLaunchArgument(
        'record', default_value='', description='New folder of a bag; none is recorded without.'
    ),
    DeclareLaunchArgument('rviz', default_value='false', description='Whether to open RViz.'),
    DeclareLaunchArgument(
        'view', default_value='false', description='Whether to serve a page for a browser.'
    ),
    DeclareLaunchArgument(
        'log_level', default_value='info', description='Of all nodes: debug, info, warn, error.'
    ),
)

LOGGING = ['--ros-args', '--log-level', LaunchConfiguration('log_level')]


def generate_launch_description() -> LaunchDescription:
    """Return everything to start."""
    namespace = LaunchConfiguration('namespace')
    clock = {'use_sim_time': LaunchConfiguration('use_sim_time')}
    record = LaunchConfiguration('record')
    guidance = Node(
        package='cmpsp_ros',
        executable='guidance_node',
        namespace=namespace,
        parameters=[LaunchConfiguration('params_file'), LaunchConfiguration('robot_file'), clock],
        arguments=LOGGING,
        output='screen',
        # A recorder of nothing would go on for ever.
        on_exit=Shutdown(reason='the guidance node has ended'),
    )
    recorder = Node(
        package='cmpsp_ros',
        executable='recorder',
        namespace=namespace,
        parameters=[
            {'output': ParameterValue(record, value_type=str), 'own_topics': True},
            clock,
        ],
        arguments=LOGGING,
        output='screen',
        condition=IfCondition(NotEqualsSubstitution(record, '')),
    )
    viewer = Node(
        package='cmpsp_ros',
        executable='viewer',
        namespace=namespace,
        parameters=[clock],
        arguments=LOGGING,
        output='screen',
        condition=IfCondition(LaunchConfiguration('view')),
    )
    rviz = Node(
        package='rviz2',
        executable='rviz2',
        arguments=['--display-config', PathJoinSubstitution([CONFIG, 'cmpsp.rviz'])],
        parameters=[clock],
        # The layout has the names of nodes without a namespace.
        remappings=[
            (name, [namespace, name])
            for name in (
                '/odom',
                '/guidance/markers',
                '/guidance/plan_markers',
                '/guidance/predicted_path',
            )
        ],
        condition=IfCondition(LaunchConfiguration('rviz')),
    )
    return LaunchDescription([*ARGUMENTS, guidance, recorder, viewer, rviz])
