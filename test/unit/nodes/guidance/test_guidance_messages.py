"""Decisions to messages that are filled again and again."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.time import Time
from std_msgs.msg import Header

from cmpsp_ros.guidance import Decision, FallbackLevel, Horizon, Plan
from cmpsp_ros.nodes.common.messages import set_stamp
from cmpsp_ros.nodes.guidance.outputs.messages import DecisionMessage, PathMessage


def decision(**changes):
    values = {
        'stamp': 12_345_678_901_234_567,
        'step': 7,
        'level': FallbackLevel.NOMINAL,
        'reason': 'Well.',
        'wheel_speeds': np.array([45.1, 44.2]),
        'steering_angle': None,
        'twist': np.array([1.5, 0.1 + 0.2]),
        'time_left': 8.6,
        'plan': None,
        'terminal_error': 1e-9,
        'clearance': 0.1,
        'worst_clearance': 0.05,
    }
    return Decision(**{**values, **changes})


def values_of(message):
    (status,) = message.status
    return {each.key: each.value for each in status.values}


def test_a_decision_carries_its_name_level_and_reason():
    made = decision(level=FallbackLevel.ELASTIC, reason='Tight.')
    message = DecisionMessage('/r1/guidance: it', 'r1', 'odom').fill(made)
    (status,) = message.status
    assert (status.name, status.message) == ('/r1/guidance: it', 'Tight.')
    assert (status.hardware_id, message.header.frame_id) == ('r1', 'odom')
    assert Time.from_msg(message.header.stamp).nanoseconds == made.stamp
    assert status.level == DiagnosticStatus.WARN
    assert values_of(message)['fallback_level'] == 'elastic'
    assert values_of(message)['finished'] == 'false'


def test_a_message_filled_again_keeps_nothing_of_the_decision_before():
    refilled = DecisionMessage('it', 'robot', 'odom')
    first = decision(level=FallbackLevel.ELASTIC, reason='Tight.', slack=0.5, phases={'solve': 1.0})
    second = decision(step=8, finished=True)
    for made in (first, second, first):
        assert refilled.fill(made) == DecisionMessage('it', 'robot', 'odom').fill(made)
    assert 'solve_ms' in values_of(refilled.fill(first))
    assert 'solve_ms' not in values_of(refilled.fill(second))


@pytest.mark.parametrize('stamp', [0, 999_999_999, 1_700_000_000_123_456_789])
def test_a_stamp_reads_back(stamp):
    header = Header()
    set_stamp(header, stamp)
    assert Time.from_msg(header.stamp).nanoseconds == stamp


def plan(edges, begin=0.0):
    count = len(edges)
    poses = np.column_stack(
        [begin + np.arange(count), -np.arange(count), np.linspace(0.0, 7.0, count)]
    )
    return Plan(Horizon.between(np.array(edges)), np.zeros((count, 2)), poses)


def test_every_pose_of_a_path_has_the_time_when_the_robot_should_be_there():
    made = plan([1_010_000_000, 1_200_000_000, 1_400_000_000, 1_500_000_000])
    stamp = 1_700_000_000_123_456_789
    path = PathMessage('odom').fill(made, stamp)
    assert path.header.frame_id == 'odom'
    assert Time.from_msg(path.header.stamp).nanoseconds == stamp
    times = [Time.from_msg(each.header.stamp).nanoseconds for each in path.poses]
    assert times == [stamp, stamp + 190_000_000, stamp + 390_000_000, stamp + 490_000_000]
    for each, (x, y, heading) in zip(path.poses, made.poses.tolist(), strict=True):
        assert each.header.frame_id == 'odom'
        assert (each.pose.position.x, each.pose.position.y) == (x, y)
        turn = each.pose.orientation
        assert (turn.x, turn.y) == (0.0, 0.0)
        assert math.cos(2.0 * math.atan2(turn.z, turn.w) - heading) == pytest.approx(1.0)
        numbers = (each.pose.position.x, turn.z, turn.w)
        assert all(type(number) is float for number in numbers)


def test_a_path_filled_again_is_as_long_as_its_plan():
    refilled, second = PathMessage('odom'), 1_000_000_000
    for edges, begin in (([0, second, 2 * second], 0.0), ([0, second], 5.0), ([0] * 4, 9.0)):
        made = plan(edges, begin)
        path = refilled.fill(made, 3 * second)
        assert path == PathMessage('odom').fill(made, 3 * second)
        assert [each.pose.position.x for each in path.poses] == made.poses[:, 0].tolist()
