"""Nodes under a robot's own names, recorded without a word on them, and replayed from any bag."""

import sys
from pathlib import Path

import pytest

from cmpsp_ros.bags import Bag, BagWriter, Names
from cmpsp_ros.bags.audit import Sources, read_record
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.nodes.common.topics import DECISION

pytestmark = pytest.mark.integration

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
