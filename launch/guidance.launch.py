"""Guide a robot: the guidance node, and beside it a recorder, a page or RViz if wanted.

`ros2 launch cmpsp_ros guidance.launch.py params_file:=my_course.yaml record:=my_bag rviz:=true`
"""

import difflib
import os
import sys
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(__file__).parents[1] / 'config'

FILES = 'guidance.launch.py', 'demo.launch.py'
"""The second includes the first, and has no argument that the first has not."""

RECORDER_TIMEOUT = 10.0

SHOWN = (
    'odom',
    'goal_pose',
    'guidance/markers',
    'guidance/plan_markers',
    'guidance/predicted_path',
    'guidance/sighting',
    'guidance/footprint',
    'guidance/tracks',
    'map',
    'scan',
)
"""Topics of the layout for RViz, which has no namespace."""

ARGUMENTS = {
    'namespace': ('', 'Of all nodes, as in r1.'),
    'use_sim_time': ('false', 'Whether time comes from /clock.'),
    # Without a default: the paper's course is not that of the robot that happens to listen.
    'params_file': (None, 'Parameters of course and robot. Required.'),
    'robot_file': ('', 'Parameters of the robot, which count before those of params_file.'),
    'autostart': ('false', 'Whether the robot sets off by itself; else: ros2 lifecycle set.'),
    'odom': ('odom', 'Topic of the odometry.'),
    'cmd_vel': ('cmd_vel', 'Topic of the commands.'),
    'realtime_priority': ('', 'Instead of realtime.priority of the files.'),
    'realtime_cpu': ('', 'Instead of realtime.cpu of the files.'),
    'record': ('', 'New folder of a bag; none is recorded without.'),
    'rviz': ('false', 'Whether to open RViz.'),
    'view': ('false', 'Whether to serve a page for a browser.'),
    'view_port': ('8765', 'Port of that page; when it is taken, the next one that is free.'),
    'log_level': ('info', 'Of all nodes: debug, info, warn, error.'),
}
"""By name: default, and what it is."""


def is_on(text: str) -> bool:
    """Whether an argument says yes, by the words of launch."""
    return text.lower() in {'true', '1'}


def unknown(arguments: list[str]) -> list[str]:
    """Arguments of the command line that are none of these files, with those that are nearest."""
    found = []
    for name in (each.partition(':=')[0] for each in arguments):
        if name not in ARGUMENTS:
            near = difflib.get_close_matches(name, ARGUMENTS, n=1)
            wanted = f'did you mean {near[0]}?' if near else f'wanted {", ".join(ARGUMENTS)}'
            found.append(f'{name}: found an unknown argument, {wanted}')
    return found


def is_launched(command: list[str]) -> bool:
    """Whether a command line launches these files: others that include them have arguments, too."""
    return any(Path(each).name in FILES for each in command)


def refusals(given: dict[str, str]) -> list[str]:
    """What cannot work, found before anything is started: nothing is left behind then."""
    found = [
        f'{name}: found no file {given[name]}'
        for name in ('params_file', 'robot_file')
        if given[name] and not Path(given[name]).is_file()
    ]
    if given['record'] and Path(given['record']).exists():
        found.append(f'record: found {given["record"]}, wanted a folder that is not there yet')
    if is_on(given['rviz']):
        try:
            get_package_prefix('rviz2')
        except PackageNotFoundError:
            found.append('rviz: found no package rviz2, wanted it (apt install ros-jazzy-rviz2)')
    return found


def nodes(given: dict[str, str]) -> list[Node]:
    """Everything to start: what only looks on first, and last what moves the robot."""
    namespace, record = given['namespace'].strip('/'), given['record']
    clock = {'use_sim_time': is_on(given['use_sim_time'])}
    # However this process ends, the robot stops, and nothing is left behind.
    stop = {'stop_with_process': os.getpid()}
    usual = {
        'package': 'cmpsp_ros',
        'namespace': namespace,
        'arguments': ['--ros-args', '--log-level', given['log_level']],
        'output': 'screen',
        'remappings': [('odom', given['odom']), ('cmd_vel', given['cmd_vel'])],
    }
    started = []
    if is_on(given['rviz']):
        place = f'/{namespace}' if namespace else ''
        names = [(f'/{each}', f'{place}/{each}') for each in SHOWN[1:]]
        odometry = given['odom'] if given['odom'].startswith('/') else f'{place}/{given["odom"]}'
        started.append(
            Node(
                package='rviz2',
                executable='rviz2',
                arguments=['--display-config', str(CONFIG / 'cmpsp.rviz')],
                parameters=[clock],
                remappings=[(f'/{SHOWN[0]}', odometry), *names],
            )
        )
    if is_on(given['view']):
        port = {'port': int(given['view_port'])}
        started.append(Node(executable='viewer', parameters=[port, clock, stop], **usual))
    if record:
        bag = {'output': record, 'own_topics': True}
        started.append(Node(executable='recorder', parameters=[bag, clock, stop], **usual))
    more = {
        f'realtime.{name}': int(given[f'realtime_{name}'])
        for name in ('priority', 'cpu')
        if given[f'realtime_{name}']
    }
    own = {
        'autostart': is_on(given['autostart']),
        'recorder_timeout': RECORDER_TIMEOUT if record else 0.0,
    }
    files = [given[name] for name in ('params_file', 'robot_file') if given[name]]
    started.append(
        Node(
            executable='guidance_node',
            parameters=[*files, clock, stop, more | own],
            # A recorder of nothing would go on for ever.
            on_exit=Shutdown(reason='the guidance node has ended'),
            **usual,
        )
    )
    return started


def start(context) -> list[Node]:
    """Check the arguments and start the nodes."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    misspelt = unknown(context.argv) if is_launched(sys.argv) else []
    if found := [*misspelt, *refusals(given)]:
        raise RuntimeError('; '.join(found))
    return nodes(given)


def generate_launch_description() -> LaunchDescription:
    """Return everything to start."""
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])
