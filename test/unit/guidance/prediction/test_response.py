"""The lag of the wheels, told from where a robot comes."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, PERIOD, ROAD, START, drive

from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.prediction.lag import LagEstimate
from cmpsp_ros.robots.differential_drive import DifferentialDrive
from cmpsp_ros.simulator.plant import Plant, PlantSettings
from cmpsp_ros.studies.monte_carlo.driving import drive as drive_study
from cmpsp_ros.studies.monte_carlo.study import Study

ROBOT = DifferentialDrive(max_wheel_speed=51.0)
COMMANDS = np.array([(20.0, 18.0), (40.0, 30.0), (45.0, 48.0), (30.0, 32.0), (10.0, 5.0)])
LONGEST = 0.3


def estimated(lag, noise=0.0, push=0.0, commands=COMMANDS):
    """An estimate after these commands, to a robot whose wheels lag by as much."""
    plant = Plant(PlantSettings(ROBOT, START, wheel_lag=lag))
    estimate, random = LagEstimate(LONGEST), np.random.default_rng(1)
    before = np.zeros(2)
    for step, command in enumerate([*commands, np.zeros(2)]):
        stamp = step * PERIOD
        plant.advance(stamp)
        pose = plant.measure() + noise * random.standard_normal(3) + (step == 3) * push
        estimate.advance(stamp, before, ROBOT)
        estimate.see(pose, ROBOT.half_track)
        plant.command(stamp, *ROBOT.twist(command))
        before = command
    return estimate


@pytest.mark.parametrize('lag', [0.0, 0.05, 0.11, 0.2, 0.28])
@pytest.mark.parametrize('noise', [0.0, 0.003])
def test_the_true_lag_is_among_the_possible_ones(lag, noise):
    _, least, longest = estimated(lag, noise).figures
    assert least <= lag <= longest
    assert noise or longest - least <= 0.1


def test_of_a_robot_at_rest_nothing_is_known():
    estimate = estimated(0.2, commands=np.zeros((10, 2)))
    assert estimate.figures == (0.0, 0.0, LONGEST)
    assert [lag for lag, _ in estimate.possible] == pytest.approx([0.1, 0.2, 0.3])


def test_what_no_lag_explains_leaves_all_possible():
    _, least, longest = estimated(0.2, push=0.3).figures
    assert (least, longest) == (0.0, LONGEST)


def test_noise_makes_the_interval_wider():
    quiet, loud = (estimated(0.15, noise).figures for noise in (0.0, 0.01))
    assert loud[2] - loud[1] > quiet[2] - quiet[1]


def test_commands_must_be_clear_for_no_other_lags_than_those_possible():
    estimate = estimated(0.2)
    _, least, longest = estimate.figures
    lags = [lag for lag, _ in estimate.possible]
    assert lags[0] == pytest.approx(least)
    assert lags[-1] == longest


def test_a_delay_is_taken_for_no_lag():
    given = replace(CASES['case 3'], initial_guess=ROAD, max_lag=LONGEST, command_delay=0.1)
    law = GuidanceLaw(given)
    run = drive(law, given, [k * PERIOD for k in range(5)])
    assert run.decisions[-1].wheel_lag == (0.0, 0.0, LONGEST)


def test_a_plan_begins_where_the_lag_that_is_estimated_leads():
    """No speed was clear for all lags, and this robot stopped on its way."""
    task = Study('heavy').run(10)
    driven = drive_study(task)
    lag, least, longest = driven.decisions[-1].wheel_lag
    assert least <= task.plant.wheel_lag <= longest
    assert lag == pytest.approx(task.plant.wheel_lag, abs=0.0251)
    assert np.hypot(*(driven.at(10_000_000_000)[:2] - task.settings.goal)) < 0.05
    assert driven.clearance().min() > 0.0
