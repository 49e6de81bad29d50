"""Goals that were told under way: replayed at the same control step, and audited."""

import math

import numpy as np
import pytest
from recorded_drives import dropping, editing, moving

from cmpsp_ros.bags import BagError, Names
from cmpsp_ros.bags.audit import CheckOutcome, audit
from cmpsp_ros.bags.replay.replay import replay

NAMES = Names.under('')
ALONG = {'x': 7.0, 'y': -7.0, 'heading': math.pi / 4.0}


def finding(path, check):
    return next(each for each in audit(path) if each.check == check)


@pytest.fixture
def told(drive, bag):
    """A drive with goals: before the start, refused ones, two that count, one of later, a reset."""
    with drive() as run:
        run.tell(**ALONG, heard=False)
        run.go(1.0)
        run.tell(0.0, 0.0, 0.0)
        run.tell(**ALONG, frame_id='map')
        run.tell(math.nan, 0.0, 0.0)
        run.go(0.5)
        run.tell(**ALONG)
        run.go(1.1)
        run.tell(9.5, -3.0, 1.2, stamp=run.now + 400_000_000)
        run.go(12.0)
        run.tell(**ALONG, heard=False)
        run.activate()
        run.pose = np.array([0.0, -9.25, 0.0])
        run.go(1.0)
        run.tell(**ALONG)
        run.go(8.0)
    return run.decisions


def test_a_replay_is_told_the_same(told, bag):
    assert [each.goals_received for each in told if each.goals_received] != []
    assert {each.goal.name for each in told} == {'', 'goal_pose'}
    assert any(each.finished and not each.missed for each in told)
    outcome = replay(bag, NAMES)
    assert str(outcome).startswith(f'identical: {len(told)} decisions')


def test_a_goal_that_is_not_in_the_bag_is_missed(told, alter):
    with pytest.raises(BagError, match='wanted all of them on goal_pose'):
        replay(alter(dropping('/goal_pose', 5)), NAMES)


def test_another_goal_makes_another_drive(told, alter):
    moved = alter(editing('/goal_pose', moving('pose.position.x', 0.01), 4))
    assert replay(moved, NAMES).differing > 0


def test_goals_that_were_told_are_audited(told, bag):
    found = finding(bag, 'goal')
    assert found.outcome is CheckOutcome.PASSED
    assert found.worst < 1e-3
    assert 'It is the worst of 2 goals.' in found.sentence
