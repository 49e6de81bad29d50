"""Exact arcs and their derivatives, against quadrature and complex steps."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive

RIGHT, LEFT = 0, 1
unhurried = hypothesis_settings(deadline=None, max_examples=60)
ROBOT = DifferentialDrive(max_wheel_speed=51.0)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)

# Wheel-speed differences [rad/s] around none at all, and around a half turn of 0.01 rad in 0.2 s.
SEAM = 0.02 / 0.2 * 2.0 * 0.055 / 0.035
DIFFERENCES = [0.0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, SEAM * (1 - 1e-9), SEAM * (1 + 1e-9), 5.0]

speeds = st.floats(-51.0, 51.0)
poses = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-7.0, 7.0))
durations = st.floats(0.001, 1.0)


def by_quadrature(pose, wheels, duration, robot=ROBOT):
    """One step by integrating (91) numerically; takes complex numbers."""
    speed = robot.wheel_radius * (wheels[RIGHT] + wheels[LEFT]) / 2.0
    turn_rate = robot.wheel_radius * (wheels[RIGHT] - wheels[LEFT]) / (2.0 * robot.half_track)
    times = duration * (NODES + 1.0) / 2.0
    heading = pose[2] + turn_rate * times
    weights = speed * duration / 2.0 * WEIGHTS
    return np.array(
        [
            pose[0] + weights @ np.cos(heading),
            pose[1] + weights @ np.sin(heading),
            pose[2] + turn_rate * duration,
        ]
    )


def by_complex_steps(function, at):
    columns = []
    for i in range(len(at)):
        ahead = np.array(at, dtype=complex)
        ahead[i] += 1e-30j
        columns.append(function(ahead).imag / 1e-30)
    return np.column_stack(columns)


@pytest.mark.parametrize('sign', [1.0, -1.0])
@pytest.mark.parametrize('difference', DIFFERENCES)
@pytest.mark.parametrize('mean', [45.0, 0.0, -20.0])
def test_step_and_jacobians(mean, difference, sign):
    wheels = np.array([mean + sign * difference / 2.0, mean - sign * difference / 2.0])
    pose, duration = np.array([1.0, -2.0, 0.7]), 0.2
    path = ROBOT.roll_out(pose, wheels[None], np.array([duration]))
    np.testing.assert_array_equal(path[0], pose)
    np.testing.assert_allclose(path[1], by_quadrature(pose, wheels, duration), atol=1e-14)
    A, B = ROBOT.jacobians(path, wheels[None], np.array([duration]))
    by_pose = by_complex_steps(lambda at: by_quadrature(at, wheels, duration), pose)
    by_wheels = by_complex_steps(lambda at: by_quadrature(pose, at, duration), wheels)
    np.testing.assert_allclose(A[0], by_pose, atol=1e-14)
    np.testing.assert_allclose(B[0], by_wheels, atol=2e-14)


@unhurried
@given(pose=poses, wheels=st.tuples(speeds, speeds), duration=durations)
def test_jacobians_anywhere(pose, wheels, duration):
    pose, wheels = np.array(pose), np.array(wheels)
    path = ROBOT.roll_out(pose, wheels[None], np.array([duration]))
    np.testing.assert_allclose(path[1], by_quadrature(pose, wheels, duration), atol=1e-11)
    A, B = ROBOT.jacobians(path, wheels[None], np.array([duration]))
    by_pose = by_complex_steps(lambda at: by_quadrature(at, wheels, duration), pose)
    by_wheels = by_complex_steps(lambda at: by_quadrature(pose, at, duration), wheels)
    np.testing.assert_allclose(A[0], by_pose, atol=1e-11)
    np.testing.assert_allclose(B[0], by_wheels, atol=1e-11)


def test_path_is_that_of_many_small_straight_moves():
    wheels, pieces = np.array([[40.0, 30.0], [-10.0, 25.0]]), 200_000
    path = ROBOT.roll_out(np.array([0.5, -9.0, 0.2]), wheels, np.array([0.3, 0.7]))
    x, y, heading = path[0]
    for (speed, turn_rate), duration in zip(ROBOT.twist(wheels), (0.3, 0.7), strict=True):
        step = duration / pieces
        headings = heading + turn_rate * step * (np.arange(pieces) + 0.5)
        x += speed * step * np.cos(headings).sum()
        y += speed * step * np.sin(headings).sum()
        heading += turn_rate * duration
    np.testing.assert_allclose(path[-1], [x, y, heading], atol=1e-9)


def test_equation_91_by_hand():
    np.testing.assert_allclose(
        ROBOT.twist(np.array([12.0, 8.0])), [0.35, 0.035 * 4.0 / 0.11], rtol=1e-15
    )
    assert ROBOT.twist(np.array([1.0, 0.0]))[1] > 0.0, 'the right wheel alone turns it left'
    assert ROBOT.max_speed == 0.035 * 51.0
    limits = ROBOT.twist_limits()
    corner = np.array([51.0, -51.0])
    assert limits.turn_rate == pytest.approx(ROBOT.twist(corner)[1])
    with pytest.raises(ValueError, match='twist limits'):
        DifferentialDrive().twist_limits()


@unhurried
@given(wheels=st.tuples(speeds, speeds))
@example(wheels=(51.0, -51.0))
def test_twist_limits_are_the_wheel_limits(wheels):
    speed, turn_rate = ROBOT.twist(np.array(wheels))
    limits = ROBOT.twist_limits()
    assert abs(speed) + limits.half_track * abs(turn_rate) <= limits.speed * (1 + 1e-12)
    assert abs(turn_rate) <= limits.turn_rate * (1 + 1e-12)


@unhurried
@given(wheels=st.lists(st.tuples(speeds, speeds), min_size=1, max_size=4))
def test_twist_and_wheel_speeds_are_inverse(wheels):
    wheels = np.array(wheels)
    np.testing.assert_allclose(ROBOT.wheel_speeds(ROBOT.twist(wheels)), wheels, atol=1e-12)
    np.testing.assert_allclose(ROBOT.twist(ROBOT.wheel_speeds(wheels)), wheels, atol=1e-12)
    np.testing.assert_allclose(ROBOT.twist(wheels[0]), ROBOT.twist(wheels)[0], atol=1e-14)


@unhurried
@given(
    pose=poses,
    motion=poses,
    wheels=st.lists(st.tuples(speeds, speeds), min_size=1, max_size=6),
    duration=durations,
)
def test_moving_the_start_moves_the_path(pose, motion, wheels, duration):
    pose, wheels = np.array(pose), np.array(wheels)
    times = np.full(len(wheels), duration)
    dx, dy, angle = motion
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])

    def moved(path):
        return np.column_stack([path[:, :2] @ turn.T + [dx, dy], path[:, 2] + angle])

    here = ROBOT.roll_out(pose, wheels, times)
    there = ROBOT.roll_out(moved(pose[None])[0], wheels, times)
    np.testing.assert_allclose(there, moved(here), atol=1e-11)


@unhurried
@given(pose=poses, wheels=st.tuples(speeds, speeds), duration=durations, part=st.floats(0.0, 1.0))
def test_a_period_in_two_parts_ends_at_the_same_place(pose, wheels, duration, part):
    pose, wheels = np.array(pose), np.array([wheels])
    whole = ROBOT.roll_out(pose, wheels, np.array([duration]))
    parts = np.array([part, 1.0 - part]) * duration
    halves = ROBOT.roll_out(pose, np.vstack([wheels, wheels]), parts)
    np.testing.assert_allclose(halves[-1], whole[-1], atol=1e-12)


@unhurried
@given(pose=poses, wheels=st.tuples(speeds, speeds), duration=durations)
def test_driving_back_leads_back(pose, wheels, duration):
    pose, wheels = np.array(pose), np.array([wheels, wheels]) * [[1.0], [-1.0]]
    back = ROBOT.roll_out(pose, wheels, np.array([duration, duration]))
    np.testing.assert_allclose(back[-1], pose, atol=1e-12)


def test_more_controls_than_durations_are_not_driven():
    wheels = np.array([[40.0, 30.0], [1.0, 2.0]])
    path = ROBOT.roll_out(np.zeros(3), wheels, np.array([0.2]))
    assert path.shape == (2, 3)
    A, B = ROBOT.jacobians(path, wheels, np.array([0.2]))
    assert A.shape == (1, 3, 3)
    assert B.shape == (1, 3, 2)
