"""The response of the robot to commands, told from where it comes."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, PERIOD, ROAD, START, assert_is, drive

from cmpsp_ros.guidance import GuidanceLaw, Observation, Safety
from cmpsp_ros.guidance.prediction.pending_commands import PendingCommands
from cmpsp_ros.guidance.prediction.response_estimate import ResponseEstimate
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import Plant, PlantSettings
from cmpsp_ros.studies.monte_carlo.driving import drive as drive_study
from cmpsp_ros.studies.monte_carlo.study import Study

ROBOT = DifferentialDrive(max_wheel_speed=51.0)
COMMANDS = np.array([(20.0, 18.0), (40.0, 30.0), (45.0, 48.0), (30.0, 32.0), (10.0, 5.0)])
LONGEST = 0.3
SETTINGS = replace(CASES['case 3'], max_lag=LONGEST, delay_tolerance=0.0)


def estimated(
    lag, noise=0.0, push=0.0, commands=COMMANDS, given=SETTINGS, delay=0.0, jump=0.0, times=1
):
    """An estimate after these commands, to a robot that responds so."""
    plant = Plant(PlantSettings(ROBOT, START, wheel_lag=lag, actuation_delay=delay))
    estimate, random = ResponseEstimate(given), np.random.default_rng(1)
    given_before = PendingCommands()
    for step, command in enumerate([*np.tile(commands, (times, 1)), np.zeros(2)]):
        stamp = step * PERIOD
        plant.advance(stamp)
        pose = plant.measure() + noise * random.standard_normal(3)
        pose += (step == 3) * push + (step == 4) * np.array([jump, 0.0, 0.0])
        estimate.update(stamp, pose, given_before, ROBOT, 0.0)
        plant.command(stamp, *ROBOT.twist(command))
        given_before.add(stamp, command, ROBOT.twist(command))
    return estimate


@pytest.mark.parametrize('lag', [0.0, 0.05, 0.11, 0.2, 0.28])
@pytest.mark.parametrize('noise', [0.0, 0.003])
def test_the_true_lag_is_among_the_possible_ones(lag, noise):
    _, least, longest = estimated(lag, noise).lag_interval
    assert least - 0.0126 <= lag <= longest + 0.0126
    assert noise or longest - least <= 0.1


def test_of_a_robot_at_rest_nothing_is_known():
    estimate = estimated(0.2, commands=np.zeros((10, 2)))
    assert estimate.lag_interval == (0.0, 0.0, LONGEST)
    risk = estimate.risk(0, PendingCommands())
    assert [each.lag for each in risk.responses] == pytest.approx([0.1, 0.2, 0.3])


def test_a_push_leaves_many_lags_possible():
    _, least, longest = estimated(0.2, push=0.1).lag_interval
    assert longest - least > 0.15


def test_a_jump_says_nothing():
    """No response of this robot to any command leads there: it is relocalised, or odometry errs."""
    quiet, jumped = estimated(0.2), estimated(0.2, jump=2.0)
    assert jumped.error < quiet.error + 0.03
    assert jumped.lag == pytest.approx(0.2, abs=0.03)


def test_noise_makes_the_interval_wider():
    quiet, loud = (estimated(0.15, noise).lag_interval for noise in (0.0, 0.02))
    assert loud[2] - loud[1] > quiet[2] - quiet[1]


def test_commands_must_be_clear_for_no_other_lags_than_those_possible():
    estimate = estimated(0.2)
    _, least, longest = estimate.lag_interval
    lags = [each.lag for each in estimate.risk(6 * PERIOD, PendingCommands()).responses]
    assert lags[0] == pytest.approx(least)
    assert lags[-1] == longest


@pytest.mark.parametrize('told', [0.0, 0.06, 0.1, 0.17, 0.2])
@pytest.mark.parametrize(('delay', 'lag'), [(0.1, 0.0), (0.0, 0.1), (0.05, 0.05)])
@pytest.mark.parametrize('noise', [0.0, 0.003])
def test_a_delay_that_is_told_wrong_is_corrected(told, delay, lag, noise):
    given = replace(CASES['case 3'], command_delay=told)
    estimate = estimated(lag, noise, given=given, delay=delay, times=2)
    in_use = estimate.delay / 1e9 + estimate.lag
    assert in_use == pytest.approx(delay + lag, abs=0.015)
    if abs(delay + lag - told) > 0.02:
        assert estimate.is_corrected
        _, least, longest = estimate.delay_interval
        assert least - 0.011 <= delay + lag <= longest + 0.011


@pytest.mark.parametrize(
    ('told', 'lag', 'delay'), [(0.2, 0.1, 0.0), (0.0, 0.1, 0.0), (0.2, 0.0, 0.1)]
)
def test_a_push_spoils_no_correction(told, lag, delay):
    """Or a command that was lost: what no response explains is forgotten."""
    given = replace(CASES['case 3'], command_delay=told)
    estimate = estimated(lag, push=0.1, given=given, delay=delay, times=3)
    assert estimate.is_corrected
    assert estimate.delay / 1e9 + estimate.lag == pytest.approx(0.1, abs=0.015)


def test_beyond_its_bounds_nothing_is_corrected():
    given = replace(CASES['case 3'], command_delay=0.0)
    estimate = estimated(0.0, given=given, delay=0.11, times=3)
    assert estimate.delay_interval[0] == pytest.approx(0.1)
    told = replace(given, delay_tolerance=0.0)
    assert estimated(0.0, given=told, delay=0.11).delay_interval is None


def test_noise_alone_corrects_nothing():
    for delay in (0.0, 0.1):
        given = replace(CASES['case 3'], command_delay=delay)
        estimate = estimated(0.0, 0.02, given=given, delay=delay, times=4)
        assert estimate.delay_interval is None
        assert estimate.error > 0.01


def test_a_robot_as_told_is_predicted_exactly():
    estimate = estimated(0.0, given=CASES['case 3'], times=3)
    assert estimate.error == 0.0
    assert estimate.risk(0, PendingCommands()).responses == []


def test_predictions_that_are_beyond_all_bounds_stop_the_robot(fault):
    """The wheels do not turn, whatever is commanded."""
    given = replace(CASES['case 3'], initial_guess=ROAD, safety=Safety(max_prediction_error=0.25))
    law, stopped = GuidanceLaw(given, given.world), []
    for step in range(5):
        decision = law.step(Observation(step * PERIOD, np.array(START)))
        if 'safety.max_prediction_error' in decision.reason:
            stopped.append(decision)
    assert stopped
    assert not any(each.twist.any() for each in stopped)
    assert all(each.prediction_error > 0.25 for each in stopped)
    for each in stopped:
        assert_is(fault, each)


def test_a_delay_is_taken_for_no_lag():
    given = replace(CASES['case 3'], initial_guess=ROAD, max_lag=LONGEST, command_delay=0.1)
    law = GuidanceLaw(given, given.world)
    run = drive(law, replace(given, command_delay=0.1), [k * PERIOD for k in range(5)])
    assert run.decisions[-1].prediction_error > 0.01


def test_a_plan_begins_where_the_lag_that_is_estimated_leads():
    """No speed was clear for all lags, and this robot stopped on its way."""
    task = Study('heavy').run(10)
    driven = drive_study(task)
    lag, least, longest = driven.decisions[-1].wheel_lag
    assert least <= task.plant.wheel_lag <= longest
    assert lag == pytest.approx(task.plant.wheel_lag, abs=0.0251)
    assert np.hypot(*(driven.at(10_000_000_000)[:2] - task.settings.goal)) < 0.05
    assert driven.clearance().min() > 0.0


@pytest.mark.parametrize(('seed', 'number'), [(5, 37), (1, 239)])
def test_the_last_commands_before_the_end_are_clear_under_every_lag(seed, number):
    """The stop after them led these robots off the road."""
    driven = drive_study(Study('heavy', seed=seed).run(number))
    assert driven.clearance().min() > 0.0
