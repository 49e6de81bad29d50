"""Braking along the road, where an arc that is held would leave it."""

import math

import numpy as np
import pytest

from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety import Validator
from cmpsp_ros.guidance.safety.road_braking import brakings_on_road
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.parameters.files import load_robot
from cmpsp_ros.world import FreeSpace

PERIOD = 0.2


@pytest.fixture(scope='module')
def settings():
    """A full-size car on a ring with a mean radius of 77 m."""
    road = {'road.inner_radius': 70.0, 'road.outer_radius': 85.0, 'goal.position': [77.0, 0.0]}
    course = {'obstacles.names': [], 'initial_pose': [0.0, -77.0, 0.0], 'final_time': 20.0}
    given = load_parameter_file('case3') | load_robot('car') | road | course
    given = {key: each for key, each in given.items() if not key.startswith('obstacles.')}
    return guidance_settings(TABLE.resolve(given))


def driven(settings, start, commands):
    space = FreeSpace.of(settings.road, settings.obstacles, settings.robot_radius)
    held = np.full(len(commands), PERIOD)
    poses = settings.robot.roll_out(start.pose, commands, held)
    return float(space.along(poses[:-1], settings.robot.twist(commands), held).min())


@pytest.mark.parametrize('speed', [12.0, -12.0, 3.0])
def test_it_stays_on_the_road_and_within_the_limits(settings, speed):
    pose = np.array([0.0, -77.0, 0.0])
    command = np.array([speed, 0.05])
    start = PlanStart(pose, settings.robot, settings.world, previous_control=command)
    limits = PERIOD, settings.max_wheel_change
    ramp = next(brakings_on_road(start, command, PERIOD, *limits))
    commands = np.vstack([command, ramp])
    assert commands[-1, 0] == 0.0
    changes = np.abs(np.diff(commands, axis=0))
    assert changes[:, 0].max() <= settings.max_wheel_change + 1e-9
    assert changes[:, 1].max() <= settings.robot.max_steering_rate * PERIOD + 1e-9
    assert np.sign(commands[:-1, 0]).tolist() == [math.copysign(1.0, speed)] * len(ramp)
    assert driven(settings, start, commands) > 1.0


def test_a_command_is_sent_whose_arc_could_not_be_held(settings):
    pose, command = np.array([0.0, -77.0, 0.0]), np.array([12.0, 0.1])
    start = PlanStart(pose, settings.robot, settings.world, previous_control=command)
    held = np.vstack([np.linspace(1.0, 0.0, 16)[:, None] * [12.0, 0.0] + [0.0, 0.1]])
    assert driven(settings, start, held) < -0.5
    plan = np.vstack([command, command])
    verdict = Validator(settings).check(start, plan, np.array([PERIOD]))
    assert verdict.passed, verdict.reason
    assert driven(settings, start, np.vstack([command, verdict.ramp])) >= 0.0
