"""Drive the simulated robot: the simulator, and all of guidance.launch.py with its arguments.

`ros2 launch cmpsp_ros demo.launch.py rviz:=true`
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare('cmpsp_ros')

ARGUMENTS = (
    DeclareLaunchArgument('namespace', default_value='', description='Of all nodes, as in r1.'),
    DeclareLaunchArgument(
        'use_sim_time',
        default_value='false',
        description='Whether the simulator publishes /clock, and time comes from it.',
    ),
    DeclareLaunchArgument(
        'params_file',
        default_value=PathJoinSubstitution([SHARE, 'config', 'case3.yaml']),
        description='Parameters of course, robot and simulator.',
    ),
    DeclareLaunchArgument(
        'robot_file',
        # Twice the same file is the file.
        default_value=LaunchConfiguration('params_file'),
        description='Parameters of the robot, which count before those of params_file.',
    ),
    DeclareLaunchArgument(
        'log_level', default_value='info', description='Of all nodes: debug, info, warn, error.'
    ),
)


def generate_launch_description() -> LaunchDescription:
    """Return everything to start."""
    clock = LaunchConfiguration('use_sim_time')
    simulator = Node(
        package='cmpsp_ros',
        executable='sim_node',
        namespace=LaunchConfiguration('namespace'),
        parameters=[
            LaunchConfiguration('params_file'),
            LaunchConfiguration('robot_file'),
            {'publish_clock': clock},
        ],
        arguments=['--ros-args', '--log-level', LaunchConfiguration('log_level')],
        output='screen',
        on_exit=Shutdown(reason='the simulator has ended'),
    )
    # It finds the arguments of above where it looks for its own, and has more beside.
    guidance = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(PathJoinSubstitution([SHARE, 'launch', 'guidance.launch.py']))
    )
    return LaunchDescription([*ARGUMENTS, simulator, guidance])
