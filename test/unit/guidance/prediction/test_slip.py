"""Wheel slip: estimated from odometry, and made up for."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, START, reconfigure
from test_command_delay import Drive

from cmpsp_ros.guidance import Observation
from cmpsp_ros.guidance.prediction.slip import SlipEstimate
from cmpsp_ros.robots import DifferentialDrive

PERIOD = 200_000_000
ROBOT = DifferentialDrive()
CASE_3 = CASES['case 3']
STILL = np.zeros(3)


def see(estimate, slip, speeds, k=0, most=0.1, noise=0.0):
    """One period from rest at the origin, with the wheels as they were before; whether it told."""
    speeds = np.array([speeds, speeds], dtype=float)
    came = ROBOT.roll_out(STILL, (1.0 - slip) * speeds[1:], np.array([0.2]))[-1]
    estimate.begin(k * PERIOD, STILL, speeds, np.empty(0))
    return estimate.end((k + 1) * PERIOD, came + noise, ROBOT, most)


@pytest.mark.parametrize('slip', [0.0, 0.03, 0.08])
@pytest.mark.parametrize('speeds', [(40.0, 40.0), (42.0, 38.0), (-30.0, -30.0)])
def test_it_comes_to_the_slip_there_is(slip, speeds):
    estimate = SlipEstimate(0.0)
    for k in range(200):
        see(estimate, slip, speeds, k)
    assert estimate.slip == pytest.approx(slip, abs=0.0051)


def test_it_is_between_nothing_and_the_most():
    fast, slow = SlipEstimate(0.0), SlipEstimate(0.0)
    for k in range(50):
        see(slow, 0.4, (40.0, 40.0), k)
        see(fast, -0.1, (40.0, 40.0), k)
    assert (slow.slip, fast.slip) == (0.1, 0.0)


def test_it_follows_in_steps_and_says_when():
    estimate = SlipEstimate(0.0)
    told = [see(estimate, 0.03, (40.0, 40.0), k) for k in range(100)]
    assert 1 <= sum(told) <= 6
    assert not any(told[60:])


def test_a_change_of_speed_is_no_slip():
    estimate = SlipEstimate(0.0)
    for speeds in ([[0.0, 0.0], [40.0, 40.0]], [[40.0, 20.0], [40.0, 40.0]]):
        estimate.begin(0, STILL, np.array(speeds), np.empty(0))
        assert not estimate.end(PERIOD, STILL, ROBOT, 0.1)
    assert not see(estimate, 0.5, (0.0, 0.0))
    assert estimate.slip == 0.0


def test_a_lost_period_is_left_out():
    estimate = SlipEstimate(0.0)
    estimate.begin(0, STILL, np.full((2, 2), 40.0), np.empty(0))
    estimate.lose()
    assert not estimate.end(PERIOD, STILL, ROBOT, 0.1)
    estimate.begin(0, STILL, np.full((3, 2), 40.0), np.array([0.3]))
    assert not estimate.end(PERIOD, STILL, ROBOT, 0.1)
    see(estimate, 0.3, (40.0, 40.0))
    assert estimate.slip > 0.0
    assert SlipEstimate(0.1).slip == 0.05


def test_noise_averages_out():
    estimate, rng = SlipEstimate(0.0), np.random.default_rng(1)
    for k in range(50):
        see(estimate, 0.03, (40.0, 40.0), k, noise=rng.normal(0.0, [0.007, 0.007, 0.01]))
    assert estimate.slip == pytest.approx(0.03, abs=0.011)


@pytest.mark.parametrize('delay', [0.0, 0.06])
def test_a_slipping_robot_arrives_if_it_is_compensated(delay):
    told = replace(CASE_3, command_delay=delay)
    slipping = {'wheel_slip': (0.03, 0.03), 'actuation_delay': delay}
    unaware = Drive(told, **slipping)
    aware = Drive(replace(told, max_slip=0.1), **slipping)
    assert aware.miss < 0.3 * unaware.miss
    assert aware.miss < 2e-3
    assert aware.clearance > 0.0
    slips = [each.wheel_slip for each in aware.decisions]
    assert slips[0] == 0.05
    assert slips[-1] == pytest.approx(0.03, abs=0.0051)


def test_a_robot_without_slip_arrives_as_well():
    """Slip is expected of it for a second or so, and then no more."""
    drive = Drive(replace(CASE_3, max_slip=0.1))
    slips = [each.wheel_slip for each in drive.decisions]
    assert slips[0] == 0.05
    assert slips == sorted(slips, reverse=True)
    assert max(slips[10:]) == 0.0
    assert drive.miss < 1e-6
    assert drive.clearance > 0.0


def test_a_reset_forgets_it_and_a_live_change_does_not():
    drive = Drive(replace(CASE_3, max_slip=0.1), wheel_slip=(0.03, 0.03))
    law = drive.law
    reconfigure(law, replace(drive.settings, goal_tolerance=0.02))
    stamp = drive.decisions[-1].stamp + PERIOD
    assert law.halt(stamp, 'Test.').wheel_slip > 0.0
    law.reset()
    assert law.step(Observation(2 * stamp, np.array(START))).wheel_slip == 0.05
    assert math.isfinite(drive.miss)
