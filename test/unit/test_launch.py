"""The launch files name what there is, and refuse what cannot work before anything is started.

`launch` is not on the Python package index. So what they decide is run here by itself, and what
they start is run by its command lines in test/integration/test_launch_commands.py.
"""

import re
from pathlib import Path

import pytest

from cmpsp_ros.parameters import TABLE, is_of_ros

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
USUAL = {
    'namespace', 'use_sim_time', 'params_file', 'robot_file', 'autostart', 'odom', 'cmd_vel',
    'log_level',
}  # fmt: skip
OF_OTHERS = {'output', 'own_topics', 'port'}
EVERYTHING = {'record': 'bag', 'rviz': 'true', 'view': 'true', 'realtime_cpu': '0'}

by_file = pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)
guidance = FILES[-1]


def given(launch_file, **arguments):
    defaults = {name: default for name, (default, _) in launch_file['ARGUMENTS'].items()}
    return {**defaults, 'params_file': str(ROOT / 'config/case3.yaml'), **arguments}


@by_file
def test_it_has_the_usual_arguments_described(launch_file, file):
    arguments = launch_file(file)['ARGUMENTS']
    assert set(arguments) >= USUAL
    assert all(text.endswith('.') for _, text in arguments.values())


def test_only_a_demo_has_a_course_by_default_and_sets_off(launch_file):
    course, autostart = 'params_file', 'autostart'
    demo, robot = (launch_file(file)['ARGUMENTS'] for file in FILES)
    assert (demo[course][0], demo[autostart][0]) == (str(ROOT / 'config/case3.yaml'), 'true')
    assert (robot[course][0], robot[autostart][0]) == (None, 'false')


@by_file
def test_every_node_is_an_executable_of_the_package_and_tells_its_level(launch_file, file):
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    known = {('cmpsp_ros', each) for each in re.findall(r"'(\w+) = cmpsp_ros\.", setup)}
    loaded = launch_file(file)
    nodes = loaded['nodes'](given(loaded, **EVERYTHING))
    assert nodes
    for node in nodes:
        if node['package'] != 'rviz2':
            assert (node['package'], node['executable']) in known
            assert '--log-level' in node['arguments']


@by_file
def test_every_parameter_exists(launch_file, file):
    known = OF_OTHERS | TABLE.resolve({}).keys()
    loaded = launch_file(file)
    for node in loaded['nodes'](given(loaded, **EVERYTHING)):
        sets = [each for each in node['parameters'] if isinstance(each, dict)]
        assert all(key in known or is_of_ros(key) for each in sets for key in each)


def test_what_moves_the_robot_is_started_last(launch_file):
    loaded = launch_file(guidance)
    started = [each['executable'] for each in loaded['nodes'](given(loaded, **EVERYTHING))]
    assert started == ['rviz2', 'viewer', 'recorder', 'guidance_node']


def test_real_time_settings_of_the_files_stay_unless_others_are_given(launch_file):
    loaded = launch_file(guidance)
    (plain,) = loaded['nodes'](given(loaded))
    assert not any(key.startswith('realtime') for key in plain['parameters'][-1])
    (told,) = loaded['nodes'](given(loaded, realtime_priority='50', realtime_cpu='3'))
    last = told['parameters'][-1]
    assert (last['realtime.priority'], last['realtime.cpu']) == (50, 3)


def test_what_cannot_work_is_refused_before_anything_is_started(launch_file, tmp_path):
    loaded = launch_file(guidance)
    assert loaded['refusals'](given(loaded)) == []
    absent = str(tmp_path / 'absent.yaml')
    found = loaded['refusals'](
        given(loaded, params_file=absent, robot_file=absent, record=str(tmp_path), rviz='true')
    )
    names = ['params_file', 'robot_file', 'record', 'rviz']
    assert [each.partition(':')[0] for each in found] == names


def test_an_argument_that_nobody_has_is_refused_with_the_nearest_name(launch_file):
    loaded = launch_file(guidance)
    assert loaded['unknown'](['robot_file:=a.yaml', 'view:=true']) == []
    near, far = loaded['unknown'](['robot_fil:=a:=b', 'x:=1'])
    assert near == 'robot_fil: found an unknown argument, did you mean robot_file?'
    assert far.startswith('x: found an unknown argument, wanted namespace, use_sim_time, ')


def test_arguments_of_a_file_that_includes_these_are_none_of_theirs(launch_file):
    loaded = launch_file(guidance)
    for file in FILES:
        assert loaded['is_launched'](['/opt/ros2', 'launch', 'cmpsp_ros', file.name, 'a:=b'])
        assert loaded['is_launched'](['/opt/ros2', 'launch', str(file)])
    assert not loaded['is_launched'](['/opt/ros2', 'launch', 'mine', 'robot.launch.py', 'a:=b'])


def test_the_demo_has_no_argument_that_guidance_has_not(launch_file):
    demo, robot = (launch_file(file)['ARGUMENTS'] for file in FILES)
    assert demo.keys() <= robot.keys()


@pytest.mark.parametrize('namespace', ['', 'r1', '/r1'])
def test_rviz_is_told_the_topics_of_a_namespace(launch_file, namespace):
    loaded = launch_file(guidance)
    rviz, _ = loaded['nodes'](given(loaded, rviz='true', namespace=namespace, odom='wheels/odom'))
    layout = (ROOT / 'config/cmpsp.rviz').read_text(encoding='utf-8')
    place = '/r1' if namespace else ''
    told = dict(rviz['remappings'])
    assert set(told) == set(re.findall(r'Value: (/\S+)', layout))
    assert told['/odom'] == f'{place}/wheels/odom'
    assert told['/guidance/markers'] == f'{place}/guidance/markers'
