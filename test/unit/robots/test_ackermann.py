"""Cars: exact arcs and their derivatives, limits, and braking along an arc."""

import math

import numpy as np
import pytest

from cmpsp_ros.robots import Ackermann, arc_ends, braking, within_ramp

CAR = Ackermann(
    wheel_radius=0.3,
    wheel_base=2.5,
    max_steering_angle=0.6,
    max_wheel_speed=40.0,
    max_wheel_acceleration=10.0,
    max_steering_rate=0.4,
)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
HELD = np.array([0.2])


def by_quadrature(pose, control, duration):
    """One step by integrating its velocity numerically; takes complex numbers."""
    speed = 0.3 * control[0]
    turn_rate = speed * np.tan(control[1]) / 2.5
    heading = pose[2] + turn_rate * duration * (NODES + 1.0) / 2.0
    weights = speed * duration / 2.0 * WEIGHTS
    ahead = weights @ np.cos(heading), weights @ np.sin(heading), turn_rate * duration
    return np.array([pose[i] + ahead[i] for i in range(3)])


def by_complex_steps(function, at):
    columns = []
    for i in range(len(at)):
        ahead = np.array(at, dtype=complex)
        ahead[i] += 1e-30j
        columns.append(function(ahead).imag / 1e-30)
    return np.column_stack(columns)


@pytest.mark.parametrize('steering', [0.0, 1e-9, 0.3, -0.6])
@pytest.mark.parametrize('wheel', [0.0, 35.0, -20.0])
def test_step_and_jacobians(wheel, steering):
    control, pose = np.array([wheel, steering]), np.array([1.0, -2.0, 0.7])
    path = CAR.roll_out(pose, control[None], HELD)
    np.testing.assert_allclose(path[1], by_quadrature(pose, control, 0.2), atol=1e-14)
    A, B = CAR.jacobians(path, control[None], HELD)
    by_pose = by_complex_steps(lambda each: by_quadrature(each, control, 0.2), pose)
    by_control = by_complex_steps(lambda each: by_quadrature(pose, each, 0.2), control)
    np.testing.assert_allclose(A[0], by_pose, atol=1e-13)
    np.testing.assert_allclose(B[0], by_control, atol=1e-13)
    np.testing.assert_allclose(arc_ends(pose[None], CAR.twist(control)[None], HELD), path[1:])


def test_twists_and_back():
    controls = np.random.default_rng(0).uniform([-40.0, -0.6], [40.0, 0.6], (100, 2))
    np.testing.assert_allclose(CAR.controls(CAR.twist(controls)), controls, atol=1e-12)
    np.testing.assert_allclose(CAR.wheel_speeds(CAR.twist(controls)), controls[:, :1])
    np.testing.assert_array_equal(CAR.controls(np.zeros(2)), np.zeros(2))


def test_a_twist_is_steered_and_driven_as_far_as_the_car_can():
    turning_on_the_spot = CAR.limited(CAR.controls(np.array([0.01, 5.0])))
    assert turning_on_the_spot[1] == 0.6
    assert CAR.limited(CAR.controls(np.array([99.0, 0.0])))[0] == 40.0
    assert CAR.half_track == pytest.approx(2.5 / math.tan(0.6))
    limits = CAR.twist_limits()
    speed, turn_rate = np.abs(CAR.twist(np.array([40.0, 0.6])))
    assert (speed, turn_rate) == pytest.approx((limits.speed, limits.turn_rate))


def test_slower_and_at_rest_it_steers_as_before():
    control = np.array([20.0, 0.4])
    np.testing.assert_array_equal(CAR.slowed(control, 0.5), [10.0, 0.4])
    np.testing.assert_array_equal(CAR.stopped(control), [0.0, 0.4])
    assert CAR.steering_of(control) == 0.4


def test_braking_keeps_to_the_arc_and_ends_at_rest():
    plan = np.tile([20.0, 0.4], (6, 1))
    for along in (True, False):
        ramp = braking(plan, np.full(5, 0.2), 0.2, 2.0, CAR.time_scaling, along=along)
        changes = np.diff(np.vstack([plan[:1], ramp]), axis=0)
        assert np.abs(changes[:, 0]).max() <= 2.0 + 1e-9
        assert (ramp[:, 1] == 0.4).all()
        assert ramp[-1, 0] == 0.0


def test_a_ramp_steers_no_faster_than_it_can():
    plan = np.tile([20.0, 0.5], (11, 1))
    commands = within_ramp(plan, np.full(10, 0.2), np.zeros(2), 2.0, CAR.time_scaling)[:-1]
    changes = np.abs(np.diff(np.vstack([np.zeros(2), commands]), axis=0))
    np.testing.assert_allclose(changes[:, 0], 2.0)
    assert changes[:, 1].max() <= 0.4 * 0.2 + 1e-12
    assert commands[-1, 1] == 0.5


def test_the_limits_of_changes_are_of_one_size():
    at_limit = np.array([[10.0 * 0.2, 0.0], [0.0, 0.4 * 0.2]])
    np.testing.assert_allclose(np.abs(at_limit @ CAR.rate_limits.T).max(axis=1), 2.0)
