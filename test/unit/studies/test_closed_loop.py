"""The guidance law driving its own model."""

from dataclasses import replace

import numpy as np

from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.studies.closed_loop import drive

VALUES = TABLE.resolve(load_parameter_file('case3'))
SETTINGS = guidance_settings(VALUES)
START = np.array(VALUES['initial_pose'])


def driven(decisions, settings=SETTINGS):
    wheel_speeds = np.array([decision.wheel_speeds for decision in decisions[:-1]])
    durations = np.full(len(wheel_speeds), settings.control_period)
    return settings.robot.roll_out(START, wheel_speeds, durations)


def test_one_decision_each_period_and_one_that_says_it_is_over():
    decisions = list(drive(SETTINGS, START))
    assert [decision.step for decision in decisions[:-1]] == list(range(50))
    assert [decision.stamp for decision in decisions] == [200_000_000 * k for k in range(51)]
    assert [decision.finished for decision in decisions] == [False] * 50 + [True]


def test_every_decision_starts_where_the_ones_before_led():
    decisions = list(drive(SETTINGS, START))
    poses = driven(decisions)
    for decision, pose in zip(decisions[:-1], poses, strict=False):
        np.testing.assert_allclose(decision.plan.poses[0], pose, atol=1e-9)
    assert np.linalg.norm(poses[-1, :2] - SETTINGS.goal) < 1e-6
    assert decisions[-1].terminal_error < 1e-6


def test_the_start_is_left_as_it_was():
    pose = START.copy()
    list(drive(SETTINGS, pose))
    np.testing.assert_array_equal(pose, START)


def test_another_period_and_final_time():
    settings = replace(SETTINGS, control_period=0.5, final_time=11.0)
    decisions = list(drive(settings, START))
    assert len(decisions) == 23
    assert decisions[-1].finished
    assert np.linalg.norm(driven(decisions, settings)[-1, :2] - settings.goal) < 1e-6
