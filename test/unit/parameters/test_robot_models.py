"""`robot.model`: the robot of each name."""

import math

import pytest

from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file, plant_settings
from cmpsp_ros.robots import DifferentialDrive

MECANUM = {
    'robot.model': 'mecanum',
    'robot.half_wheel_base': 0.08,
    'robot.joint_names': ['a', 'b', 'c', 'd'],
    'initial_guess.type': 'road',
}
THREE = MECANUM | {
    'robot.model': 'omni_wheels',
    'robot.joint_names': ['a', 'b', 'c'],
    'robot.wheel_bearings': [1.0, 3.1, 5.2],
}


CAR = {
    'robot.model': 'ackermann',
    'robot.joint_names': ['rear'],
    'robot.wheel_base': 2.5,
    'robot.max_steering_angle': 0.6,
    'initial_guess.type': 'road',
}


def made(**changes):
    return guidance_settings(TABLE.resolve(load_parameter_file('case3') | changes))


def test_a_robot_without_a_model_is_the_differential_drive():
    assert isinstance(made().robot, DifferentialDrive)


@pytest.mark.parametrize(('given', 'wheels'), [(MECANUM, 4), (THREE, 3)])
def test_robots_that_drive_sideways(given, wheels):
    robot = made(**given).robot
    assert robot.drives_sideways
    assert robot.wheels.shape == (wheels, 3)
    assert robot.max_wheel_speed == 51.0
    assert plant_settings(TABLE.resolve(load_parameter_file('case3') | given)).robot == robot


def test_a_car():
    limited = {'robot.max_steering_rate': 0.4, 'robot.max_wheel_acceleration': 10.0}
    robot = made(**(CAR | limited)).robot
    assert (robot.wheel_base, robot.max_steering_angle, robot.max_steering_rate) == (2.5, 0.6, 0.4)
    assert not robot.turns_on_the_spot
    assert math.isinf(made(**CAR).robot.max_steering_rate)
