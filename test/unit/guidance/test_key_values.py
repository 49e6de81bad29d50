"""Decisions as text: nothing lost, nothing made up."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cmpsp_ros.guidance import (
    Decision,
    FallbackLevel,
    Horizon,
    Plan,
    decision_to_key_values,
    present_keys,
    severity,
    waypoints,
    with_former_keys,
)


def decision(**changes):
    values = {
        'stamp': 1_700_000_000_000_000_007,
        'step': 7,
        'level': FallbackLevel.NOMINAL,
        'reason': 'Well.',
        'wheel_speeds': np.array([1.0, 2.0]),
        'twist': np.array([0.1, 0.2]),
        'time_left': 8.6,
        'plan': None,
        'terminal_error': 0.1,
        'clearance': 0.2,
        'worst_clearance': 0.3,
    }
    return Decision(**{**values, **changes})


def test_every_field_of_a_decision_is_told_or_sent_in_another_way():
    sent = {'reason', 'plan', 'twist', 'wheel_speeds', 'phases'}
    # What is not the same for every run is told where there is something to tell.
    seldom = {
        'wheel_slip',
        'wheel_lag',
        'response_delay',
        'prediction_error',
        'steering_angle',
        'tracks',
        'sighting',
        'goal',
        'heading_error',
        'goals_received',
        'late',
        'skipped',
        'pose',
        'cancelled',
        'braking',
    }
    told = set(decision_to_key_values(decision(phases={'solve': 1.0})))
    named = {'wheel_speed_right', 'wheel_speed_left', 'solve_ms', 'fallback_level'}
    assert told == set(Decision._fields) - sent - seldom - {'level'} | named
    assert 'wheel_slip' in decision_to_key_values(decision(wheel_slip=0.03))


def test_what_the_law_was_told_is_in_it():
    told = decision_to_key_values(decision(halted=True, run=3, revision=2, finished=True))
    assert (told['halted'], told['run'], told['revision']) == ('true', '3', '2')
    assert told['finished'] == 'true'
    assert (
        decision_to_key_values(decision())['halted']
        == decision_to_key_values(decision())['finished']
        == 'false'
    )


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


def test_keys_of_the_version_before_are_written_and_read_for_one_release():
    made = decision(level=FallbackLevel.PREVIOUS_PLAN, heading_error=0.5, goals_received=2)
    now = decision_to_key_values(made)
    both = with_former_keys(now)
    former = {key: both[key] for key in both.keys() - now.keys()}
    assert former == {
        'rung': 'shifted',
        'miss': '0.1',
        'margin': '0.2',
        'worst_margin': '0.3',
        'heading_miss': '0.5',
        'told': '2',
    }
    renamed = now.keys() - {'fallback_level', 'terminal_error', 'clearance', 'worst_clearance'}
    before = {key: now[key] for key in renamed - {'heading_error', 'goals_received'}} | former
    assert present_keys(both.items()) == present_keys(before.items()) == now
