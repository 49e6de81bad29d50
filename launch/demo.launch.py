"""Drive the simulated robot: the simulator, and all of guidance.launch.py with its arguments.

`ros2 launch cmpsp_ros demo.launch.py rviz:=true`
"""

import os
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription, OpaqueFunction, Shutdown
from launch.launch_description_sources import PythonLaunchDescriptionSource
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(__file__).parents[1]

ARGUMENTS = {
    'namespace': ('', 'Of all nodes, as in r1.'),
    'use_sim_time': ('false', 'Whether the simulator publishes /clock, and time comes from it.'),
    'params_file': (
        str(SHARE / 'config' / 'case3.yaml'),
        'Parameters of course, robot and simulator.',
    ),
    'robot_file': ('', 'Parameters of the robot, which count before those of params_file.'),
    'autostart': ('true', 'Whether the simulated robot sets off by itself.'),
    'odom': ('odom', 'Topic of the odometry.'),
    'cmd_vel': ('cmd_vel', 'Topic of the commands.'),
    'log_level': ('info', 'Of all nodes: debug, info, warn, error.'),
}
"""By name: default, and what it is."""


def nodes(given: dict[str, str]) -> list[Node]:
    """The simulator."""
    files = [given[name] for name in ('params_file', 'robot_file') if given[name]]
    clock = {'publish_clock': given['use_sim_time'].lower() in {'true', '1'}}
    stop = {'stop_with_process': os.getpid()}
    return [
        Node(
            package='cmpsp_ros',
            executable='sim_node',
            namespace=given['namespace'].strip('/'),
            parameters=[*files, clock, stop],
            arguments=['--ros-args', '--log-level', given['log_level']],
            output='screen',
            remappings=[('odom', given['odom']), ('cmd_vel', given['cmd_vel'])],
            on_exit=Shutdown(reason='the simulator has ended'),
        )
    ]


def start(context) -> list[Node]:
    """Start the simulator."""
    return nodes({name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS})


def generate_launch_description() -> LaunchDescription:
    """Return everything to start: guidance first, for it refuses what cannot work."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    # It finds the arguments of above where it looks for its own, and has more beside; what has no
    # default there must be handed on by name.
    guidance = IncludeLaunchDescription(
        PythonLaunchDescriptionSource(str(SHARE / 'launch' / 'guidance.launch.py')),
        launch_arguments=[('params_file', LaunchConfiguration('params_file'))],
    )
    return LaunchDescription([*arguments, guidance, OpaqueFunction(function=start)])
