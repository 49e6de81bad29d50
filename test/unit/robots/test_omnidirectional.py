"""Robots that drive sideways: exact arcs and their derivatives, and what their wheels allow."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.robots import (
    arc_ends,
    arc_from,
    arc_under,
    mecanum,
    on_omni_wheels,
    plain,
    speeds_and_turns,
    with_side,
)

MECANUM = mecanum(0.13, 0.08, wheel_radius=0.05, max_wheel_speed=16.0)
THREE = on_omni_wheels(
    0.2, [math.pi / 3, math.pi, -math.pi / 3], wheel_radius=0.05, max_wheel_speed=16.0
)
FOUR = on_omni_wheels(0.2, [0.0, 1.6, 3.2, 4.6], wheel_radius=0.05, max_wheel_speed=16.0)
ROBOTS = [MECANUM, THREE, FOUR]
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)


def by_quadrature(pose, twist, duration):
    """One step by integrating its velocity numerically; takes complex numbers."""
    heading = pose[2] + twist[2] * duration * (NODES + 1.0) / 2.0
    weights = duration / 2.0 * WEIGHTS
    return np.array(
        [
            pose[0] + weights @ (twist[0] * np.cos(heading) - twist[1] * np.sin(heading)),
            pose[1] + weights @ (twist[0] * np.sin(heading) + twist[1] * np.cos(heading)),
            pose[2] + twist[2] * duration,
        ]
    )


def by_complex_steps(function, at):
    columns = []
    for i in range(len(at)):
        ahead = np.array(at, dtype=complex)
        ahead[i] += 1e-30j
        columns.append(function(ahead).imag / 1e-30)
    return np.column_stack(columns)


@pytest.mark.parametrize('turn_rate', [0.0, 1e-9, 0.3, -2.0, 20.0])
@pytest.mark.parametrize('course', [0.0, math.pi / 2, -2.5])
@pytest.mark.parametrize('robot', ROBOTS)
def test_step_and_jacobians(robot, turn_rate, course):
    twist = np.array([0.7 * math.cos(course), 0.7 * math.sin(course), turn_rate])
    pose, held = np.array([1.0, -2.0, 0.7]), np.array([0.2])
    controls = robot.controls(twist[None])
    path = robot.roll_out(pose, controls, held)
    np.testing.assert_allclose(path[1], by_quadrature(pose, twist, 0.2), atol=1e-14)
    A, B = robot.jacobians(path, controls, held)
    by_pose = by_complex_steps(lambda each: by_quadrature(each, twist, 0.2), pose)
    by_control = by_complex_steps(
        lambda each: by_quadrature(pose, robot.twist(each), 0.2), controls[0]
    )
    np.testing.assert_allclose(A[0], by_pose, atol=1e-13)
    np.testing.assert_allclose(B[0], by_control, atol=1e-13)
    np.testing.assert_allclose(arc_ends(pose[None], twist[None], held)[0], path[1], atol=1e-14)


def test_a_twist_without_speed_to_the_side_is_an_arc_along_the_heading():
    pose, twists = np.array([[1.0, 2.0, 0.4]]), np.array([[0.5, 0.0, 0.3], [-0.5, 0.0, 0.3]])
    for k, forward in enumerate((0.5, -0.5)):
        arc = arc_under(np.repeat(pose, 2, axis=0), twists, k, 0.2)
        known = arc_from(*pose[0], forward * 0.2, 0.3 * 0.2)
        np.testing.assert_allclose((arc.end_x, arc.end_y), (known.end_x, known.end_y), atol=1e-15)
    np.testing.assert_array_equal(plain(twists), twists[:, [0, 2]])
    np.testing.assert_array_equal(with_side(plain(twists)), twists)
    assert speeds_and_turns(np.array([3.0, -4.0, 0.1])).tolist() == [5.0, 0.1]


@pytest.mark.parametrize('robot', ROBOTS)
def test_wheel_speeds_and_back(robot):
    twists = np.random.default_rng(0).normal(size=(50, 3))
    wheels = robot.wheel_speeds(twists)
    np.testing.assert_allclose(robot.twist_of_wheels(wheels), twists, atol=1e-12)
    controls = robot.controls(twists)
    np.testing.assert_allclose(robot.twist(controls), twists, atol=1e-12)
    np.testing.assert_allclose(robot.speeds_of(controls), wheels, atol=1e-11)
    # The kinematics have the wheels that are controls first, and no other way.
    ordered = controls @ robot.wheels.T
    np.testing.assert_array_equal(ordered[:, :3], controls)
    np.testing.assert_allclose(np.sort(ordered), np.sort(wheels), atol=1e-11)
    np.testing.assert_array_equal(
        robot.wheel_speeds(twists[0, [0, 2]]),
        robot.wheel_speeds(np.array([twists[0, 0], 0.0, twists[0, 2]])),
    )


def test_a_mecanum_robot_turns_its_wheels_as_the_controller_of_ros2_control():
    front_left, front_right, rear_right, rear_left = MECANUM.wheel_speeds(np.array([0.3, 0.1, 0.5]))
    around = (0.13 + 0.08) * 0.5
    assert front_left == pytest.approx((0.3 - 0.1 - around) / 0.05)
    assert front_right == pytest.approx((0.3 + 0.1 + around) / 0.05)
    assert rear_right == pytest.approx((0.3 - 0.1 + around) / 0.05)
    assert rear_left == pytest.approx((0.3 + 0.1 - around) / 0.05)


@pytest.mark.parametrize('robot', ROBOTS)
def test_no_twist_that_the_wheels_can_drive_is_beyond_the_limits(robot):
    twists = np.random.default_rng(1).normal(size=(2000, 3)) * [1.0, 1.0, 4.0]
    fastest = np.abs(robot.wheel_speeds(twists)).max(axis=1)
    speed, turn_rate = np.abs(speeds_and_turns(twists * (16.0 / fastest)[:, None])).T
    limits = robot.twist_limits()
    assert (speed + limits.half_track * turn_rate <= limits.speed).all()
    assert (turn_rate <= limits.turn_rate).all()
    # Nor are the limits much wider than that.
    assert speed.max() > 0.95 * limits.speed
    assert limits.speed == pytest.approx(robot.max_speed)


def test_the_limits_of_a_mecanum_robot_are_those_of_a_differential_drive():
    limits = MECANUM.twist_limits()
    assert limits.speed == pytest.approx(0.8, rel=1e-8)
    assert limits.half_track == pytest.approx(0.21)


@pytest.mark.parametrize('robot', ROBOTS)
def test_what_is_too_fast_is_slowed_down_along_its_arc_and_never_by_a_bit_too_little(robot):
    for controls in np.random.default_rng(2).normal(size=(500, 3)) * 20.0:
        slowed = robot.limited(controls)
        assert np.abs(robot.speeds_of(slowed)).max() <= 16.0
        np.testing.assert_allclose(np.cross(slowed, controls), 0.0, atol=1e-11)


def test_slip_shortens_the_way():
    controls, held = MECANUM.controls(np.array([[0.4, 0.3, 0.5]])), np.array([0.2])
    slipping = MECANUM.slipping(0.1)
    np.testing.assert_allclose(
        slipping.roll_out(np.zeros(3), controls, held),
        MECANUM.roll_out(np.zeros(3), 0.9 * controls, held),
        atol=1e-16,
    )
    np.testing.assert_array_equal(slipping.speeds_of(controls), MECANUM.speeds_of(controls))
    assert MECANUM.slipping(0.0) is MECANUM
    assert slipping.max_speed == pytest.approx(0.9 * MECANUM.max_speed)


def test_braking_is_that_of_the_worst_direction():
    robot = replace(MECANUM, max_wheel_acceleration=20.0)
    assert robot.max_acceleration == pytest.approx(1.0)
    assert robot.braking == pytest.approx(1.0 / math.sqrt(2.0))
