"""`robot.model`: which robots there are, and what each of them cannot do without."""

import math

import pytest

from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    guidance_settings,
    load_parameter_file,
    plant_settings,
)
from cmpsp_ros.parameters.robots import MODELS
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


def refusal(**changes):
    with pytest.raises(ParameterError) as caught:
        made(**changes)
    return str(caught.value)


def test_a_robot_without_a_model_is_the_differential_drive():
    assert isinstance(made().robot, DifferentialDrive)


def test_a_name_that_is_none_is_refused_with_those_there_are():
    said = refusal(**{'robot.model': 'tank'})
    assert said.startswith("robot.model: found 'tank', wanted ")
    assert all(name in said for name in MODELS)


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


@pytest.mark.parametrize(
    ('given', 'changes', 'key'),
    [
        (MECANUM, {'robot.half_wheel_base': 0.0}, 'robot.half_wheel_base'),
        (MECANUM, {'robot.joint_names': ['a', 'b']}, 'robot.joint_names'),
        ({}, {'robot.joint_names': ['a']}, 'robot.joint_names'),
        (MECANUM, {'initial_guess.type': 'constant'}, 'initial_guess.type'),
        (MECANUM, {'plant': 'mujoco'}, 'plant'),
        (THREE, {'robot.wheel_bearings': [0.0, 1.0], 'robot.joint_names': ['a', 'b']}, 'bearings'),
        (THREE, {'robot.wheel_bearings': [1.0, 1.0, 1.0]}, 'robot.wheel_bearings'),
        (CAR, {'robot.wheel_base': 0.0}, 'robot.wheel_base'),
        (CAR, {'robot.max_steering_angle': 0.0}, 'robot.max_steering_angle'),
        (CAR, {'robot.max_steering_angle': -0.1}, 'robot.max_steering_angle'),
        (CAR, {'robot.max_steering_angle': 1.6}, 'robot.max_steering_angle'),
        (CAR, {'robot.max_steering_rate': 0.4}, 'robot.max_wheel_acceleration'),
        (CAR, {'goal.hold': True}, 'goal.hold'),
        # Wheels that all roll the same way, or against it, never move the robot aside.
        (THREE, {'robot.wheel_bearings': [0.0, 3.141592653589793, 0.0]}, 'robot.wheel_bearings'),
    ],
)
def test_what_a_model_cannot_do_names_its_key(given, changes, key):
    assert key in refusal(**(given | changes))
