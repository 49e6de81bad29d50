"""Decisions as text: nothing lost, nothing made up."""

import math

import numpy as np
import pytest

from cmpsp_ros.bags import DecisionRecord
from cmpsp_ros.guidance import (
    DECISION_KEYS,
    FIELDS,
    Decision,
    FallbackLevel,
    Goal,
    Horizon,
    Plan,
    decision_to_key_values,
    severity,
    waypoints,
)
from cmpsp_ros.guidance.messages import Track


def decision(**changes):
    values = {
        'stamp': 1_700_000_000_000_000_007,
        'step': 7,
        'level': FallbackLevel.NOMINAL,
        'reason': 'Well.',
        'wheel_speeds': np.array([1.0, 2.0]),
        'steering_angle': None,
        'twist': np.array([0.1, 0.2]),
        'time_left': 8.6,
        'plan': None,
        'terminal_error': 0.1,
        'clearance': 0.2,
        'worst_clearance': 0.3,
    }
    return Decision(**{**values, **changes})


EVERYTHING = {
    'level': FallbackLevel.PREVIOUS_PLAN,
    'wheel_speeds': np.array([1.0, -2.0, 1 / 3]),
    'steering_angle': -0.1,
    'wheel_slip': 0.03,
    'wheel_lag': (0.1, 0.0, 0.3),
    'response_delay': (0.2, 0.1, 0.25),
    'prediction_error': 0.004,
    'finished': True,
    'missed': True,
    'halted': True,
    'cancelled': True,
    'braking': True,
    'late': 0.21,
    'skipped': True,
    'pose': (1.0, 2.0, 1e-17),
    'run': 3,
    'revision': 2,
    'sighting': 0,
    'goal': Goal((7.0, -7.0), 5.4, 0.0, 'goal_pose'),
    'heading_error': 0.0,
    'goals_received': 1,
    'slack': np.float64(0.1) + 0.2,
    'active_rows': np.int64(3),
    'qp_iterations': np.int32(4),
    'terminal_error': math.inf,
    'clearance': 5e-324,
    'worst_clearance': -1e308,
}


def test_every_field_is_read_back_as_it_was_written():
    made = decision(**EVERYTHING, tracks=(Track(5, 17, 0.0, 0.0, 0.0, 0.0, 0.1),))
    record = DecisionRecord('bag', 0, made.reason, decision_to_key_values(made))
    assert set(record.entries) == DECISION_KEYS.keys() - {'wheel_speed_right', 'wheel_speed_left'}
    named = {
        'level': 'previous_plan',
        'tracks': [(5, 17)],
        'wheel_speeds': [1.0, -2.0, 1 / 3, -0.1],
    }
    for name in FIELDS.keys() - {'phases'}:
        found, wanted = getattr(record, name), named.get(name, getattr(made, name))
        assert found.tolist() == wanted if name == 'wheel_speeds' else found == wanted, name


def test_seldom_fields_are_left_out_and_have_their_defaults():
    record = DecisionRecord('bag', 0, '', decision_to_key_values(decision(phases={'step': 1.0})))
    seldom = {name for name, each in FIELDS.items() if each.seldom}
    assert not seldom & record.entries.keys()
    assert (record.wheel_speeds.tolist(), record.step_ms) == ([1.0, 2.0], 1.0)
    for name in seldom:
        assert getattr(record, name) == getattr(decision(), name)
    assert {'halted', 'finished', 'slack', 'run', 'wheel_speed_right'} <= record.entries.keys()


@pytest.mark.parametrize(
    ('fallback', 'outcome', 'level'),
    [
        (FallbackLevel.NOMINAL, {}, 0),
        (FallbackLevel.ELASTIC, {}, 1),
        (FallbackLevel.PREVIOUS_PLAN, {}, 1),
        (FallbackLevel.STOP, {}, 2),
        (FallbackLevel.STOP, {'finished': True}, 0),
        (FallbackLevel.STOP, {'finished': True, 'missed': True}, 1),
    ],
)
def test_severity(fallback, outcome, level):
    assert severity(decision(level=fallback, **outcome)) == level


def test_waypoints_are_the_plan_s_poses():
    poses = np.array([[1.0, 2.0, 0.5], [3.0, 4.0, 7.0]])
    plan = Plan(Horizon.between([0, 1]), np.zeros((2, 2)), poses)
    for (x, y, z, w), pose in zip(waypoints(plan), poses, strict=True):
        assert [x, y] == pose[:2].tolist()
        assert math.cos(2.0 * math.atan2(z, w) - pose[2]) == pytest.approx(1.0)
