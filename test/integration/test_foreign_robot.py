"""A robot that shares nothing with this package, driven by what doc/user/robots.md says."""

import math
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import yaml

from cmpsp_ros.bags import Bag, BagWriter, Names
from cmpsp_ros.bags.audit import Sources, read_record
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.nodes.common.topics import DECISION
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world import FreeSpace

HERE = Path(__file__).parent
CONFIG = HERE.parents[1] / 'config'
PAGE = HERE.parents[1] / 'doc' / 'user' / 'robots.md'
# Its first start may compile for minutes.
LIMIT = 280.0


@pytest.mark.timeout(600)
@pytest.mark.parametrize('course', ['case3', 'mapped'])
def test_it_comes_within_5_cm_of_the_goal_and_touches_nothing(spawn, ros, tmp_path, course):
    """In real time, with the parameters that the page has."""
    mine = tmp_path / 'my_robot.yaml'
    section = PAGE.read_text(encoding='utf-8').partition('## A robot of your own')[2]
    block = section.partition('```yaml\n')[2].partition('```')[0]
    mine.write_text(textwrap.dedent(block))
    miss, clearance = driven(spawn, ros, course, mine, tmp_path / 'path')
    assert miss < 0.05
    assert clearance > 0.0


@pytest.mark.timeout(600)
@pytest.mark.parametrize('told', [0.0, 0.2])
def test_a_delay_that_is_told_wrong_is_corrected(spawn, ros, tmp_path, told):
    """Told 0.2 s, without correction it misses the goal by metres, or touches an obstacle."""
    mine = tmp_path / 'my_robot.yaml'
    given = {'enable_stamped_cmd_vel': True, 'command_delay': told, 'safety.margin': 0.05}
    mine.write_text(yaml.safe_dump({'/**': {'ros__parameters': given}}))
    miss, clearance = driven(spawn, ros, 'case3', mine, tmp_path / 'path', 'inf')
    assert miss < 0.05
    assert clearance > 0.0


def driven(spawn, ros, course, mine, path, *acceleration):
    """Distance from the goal at the final time, and least clearance [m], of a real run."""
    given = load_parameter_file(course)
    start = given['initial_pose']
    files = [CONFIG / f'{course}.yaml', mine]
    flags = [part for each in files for part in ('--params-file', each)]
    module = [sys.executable, '-m', MODULES['guidance_node']]
    guidance = spawn([*module, '--ros-args', *flags, '-p', 'autostart:=true'])
    decisions = []
    ros.node.create_subscription(DECISION.type, '/guidance/decision', decisions.append, 100)
    command = [sys.executable, HERE / 'foreign_robot.py', *map(str, start), path, *acceleration]
    robot = spawn(command)

    def is_over():
        return decisions and "key='finished', value='true'" in str(decisions[-1].status[0].values)

    ros.spin_until(is_over, LIMIT)
    guidance.end()
    robot.end()
    times, *rest = np.loadtxt(path).T
    settings = guidance_settings(TABLE.resolve(given))
    # The first one heard may not be the first.
    stamp, said = decisions[0].header.stamp, decisions[0].status[0].values
    (left,) = (float(each.value) for each in said if each.key == 'time_left')
    end = stamp.sec + stamp.nanosec / 1e9 + left
    x, y = (float(np.interp(end, times, each)) for each in rest[:2])
    space = FreeSpace.of(settings.road, settings.obstacles, settings.robot_radius)
    poses = np.column_stack(rest)[times <= end]
    return math.dist((x, y), settings.goal), float(space.at(poses).min())


CASE3 = Path(__file__).parents[2] / 'config' / 'case3.yaml'
REMAPPED = ('-r', 'odom:=/wheels/odom', '-r', 'cmd_vel:=/base/cmd_vel')
ODOM, CMD_VEL = '/wheels/odom', '/base/cmd_vel'


def without_parameters(bag, path):
    """A copy as another program would have recorded it: messages and no more."""
    with Bag(bag) as opened:
        copy = BagWriter(path)
        for name, about in opened.topics.items():
            copy.topic(name, about.msgtype, about.qos_profiles)
        for name, stamp, raw in opened.raw_together(sorted(opened.topics)):
            copy.write(name, stamp, raw)
        copy.close()


def test_a_remapped_robot_is_recorded_and_replayed_from_any_bag(spawn, ros, tmp_path):
    def node(name, *flags):
        given = [part for each in flags for part in ('-p', each)]
        return spawn([sys.executable, '-m', MODULES[name], '--ros-args', *REMAPPED, *given])

    course = ['--params-file', CASE3]
    recorder = node('recorder', f'output:={tmp_path / "bag"}', 'own_topics:=true')
    module = [sys.executable, '-m']
    sim = spawn([*module, MODULES['sim_node'], '--ros-args', *REMAPPED, *course])
    flags = ['-p', 'autostart:=true', '-p', 'recorder_timeout:=30.0']
    guidance = spawn([*module, MODULES['guidance_node'], '--ros-args', *REMAPPED, *course, *flags])
    decisions = []
    ros.node.create_subscription(DECISION.type, '/guidance/decision', decisions.append, 100)
    ros.spin_until(lambda: len(decisions) > 3)
    ros.spin_until(lambda: len(decisions) > 10)
    for each in (guidance, recorder, sim):
        each.end()
    names = Names.under('', ODOM, CMD_VEL)
    without_parameters(tmp_path / 'bag', tmp_path / 'plain')
    with Bag(tmp_path / 'bag') as ours, Bag(tmp_path / 'plain') as plain:
        assert {ODOM, CMD_VEL, '/guidance/parameters'} <= set(ours.topics)
        mine, others = (each.parameters['/guidance'] for each in (ours, plain))
        assert others == {key: mine[key] for key in others}
    for bag in ('bag', 'plain'):
        outcome = replay(tmp_path / bag, names)
        assert (outcome.first, outcome.skipped) == (None, 0)
        assert outcome.commands == outcome.decisions > 10
        record = read_record(tmp_path / bag, Sources(ODOM, CMD_VEL, namespace=''))
        assert record.decisions
