"""Models of robots: exact arcs and derivatives against quadrature and complex steps, and limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import Ackermann, DifferentialDrive, Omnidirectional
from cmpsp_ros.robots.motion import (
    arc_ends,
    arc_from,
    arc_under,
    braking,
    plain,
    speeds_and_turns,
    with_side,
    within_ramp,
)

unhurried = hypothesis_settings(deadline=None, max_examples=60)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
WHEELS = {'wheel_radius': 0.05, 'max_wheel_speed': 16.0}
ROBOT = DifferentialDrive(max_wheel_speed=51.0)
CAR = Ackermann(
    wheel_radius=0.3,
    wheel_base=2.5,
    max_steering_angle=0.6,
    max_wheel_speed=40.0,
    max_wheel_acceleration=10.0,
    max_steering_rate=0.4,
)
MECANUM = Omnidirectional.mecanum(0.13, 0.08, **WHEELS)
THREE = Omnidirectional.on_omni_wheels(0.2, [math.pi / 3, math.pi, -math.pi / 3], **WHEELS)
FOUR = Omnidirectional.on_omni_wheels(0.2, [0.0, 1.6, 3.2, 4.6], **WHEELS)
SIDEWAYS = [MECANUM, THREE, FOUR]

# Wheel-speed differences [rad/s] around none at all, and around a half turn of 0.01 rad in 0.2 s.
SEAM = 0.02 / 0.2 * 2.0 * 0.055 / 0.035
DIFFERENCES = [0.0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, SEAM * (1 - 1e-9), SEAM * (1 + 1e-9), 5.0]
TWISTS = [
    (0.7 * math.cos(course), 0.7 * math.sin(course), turn_rate)
    for course in (0.0, math.pi / 2, -2.5)
    for turn_rate in (0.0, 1e-9, 0.3, -2.0, 20.0)
]

speeds = st.floats(-51.0, 51.0)
poses = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-7.0, 7.0))
durations = st.floats(0.001, 1.0)


def twist_of(robot, control):
    """Forward, to the left and turning, by the equations of the model; takes complex numbers."""
    if isinstance(robot, Ackermann):
        speed = 0.3 * control[0]
        return speed, 0.0, speed * np.tan(control[1]) / 2.5
    if isinstance(robot, DifferentialDrive):
        radius, track = robot.wheel_radius, robot.half_track
        ahead = radius * (control[0] + control[1]) / 2.0
        return ahead, 0.0, radius * (control[0] - control[1]) / (2.0 * track)
    return robot.twist(control)


def by_quadrature(robot, pose, control, duration):
    """One step by integrating its velocity numerically."""
    forward, left, turn_rate = twist_of(robot, control)
    heading = pose[2] + turn_rate * duration * (NODES + 1.0) / 2.0
    weights = duration / 2.0 * WEIGHTS
    x = pose[0] + weights @ (forward * np.cos(heading) - left * np.sin(heading))
    y = pose[1] + weights @ (forward * np.sin(heading) + left * np.cos(heading))
    return np.array([x, y, pose[2] + turn_rate * duration])


def by_complex_steps(function, at):
    columns = []
    for i in range(len(at)):
        ahead = np.array(at, dtype=complex)
        ahead[i] += 1e-30j
        columns.append(function(ahead).imag / 1e-30)
    return np.column_stack(columns)


def check(robot, pose, control, duration, error):
    held = np.array([duration])
    path = robot.roll_out(pose, control[None], held)
    np.testing.assert_array_equal(path[0], pose)
    np.testing.assert_allclose(path[1], by_quadrature(robot, pose, control, duration), atol=error)
    A, B = robot.jacobians(path, control[None], held)
    by_pose = by_complex_steps(lambda at: by_quadrature(robot, at, control, duration), pose)
    by_control = by_complex_steps(lambda at: by_quadrature(robot, pose, at, duration), control)
    np.testing.assert_allclose(A[0], by_pose, atol=error)
    np.testing.assert_allclose(B[0], by_control, atol=2.0 * error)
    np.testing.assert_allclose(
        arc_ends(pose[None], robot.twist(control)[None], held)[0], path[1], atol=error
    )


@pytest.mark.parametrize(
    ('robot', 'controls'),
    [
        (
            ROBOT,
            [
                (mean + sign * difference / 2.0, mean - sign * difference / 2.0)
                for mean in (45.0, 0.0, -20.0)
                for difference in DIFFERENCES
                for sign in (1.0, -1.0)
            ],
        ),
        (CAR, [(w, a) for w in (0.0, 35.0, -20.0) for a in (0.0, 1e-9, 0.3, -0.6)]),
        *((each, each.controls(np.array(TWISTS))) for each in SIDEWAYS),
    ],
    ids=['differential', 'car', 'mecanum', 'three', 'four'],
)
def test_step_and_jacobians(robot, controls):
    for control in controls:
        check(robot, np.array([1.0, -2.0, 0.7]), np.array(control), 0.2, 1e-13)


@unhurried
@given(pose=poses, wheels=st.tuples(speeds, speeds), duration=durations)
def test_jacobians_anywhere(pose, wheels, duration):
    check(ROBOT, np.array(pose), np.array(wheels), duration, 1e-11)


def test_equation_91_by_hand():
    np.testing.assert_allclose(
        ROBOT.twist(np.array([12.0, 8.0])), [0.35, 0.035 * 4.0 / 0.11], rtol=1e-15
    )
    assert ROBOT.twist(np.array([1.0, 0.0]))[1] > 0.0, 'the right wheel alone turns it left'
    assert ROBOT.max_speed == 0.035 * 51.0
    limits = ROBOT.twist_limits()
    assert limits.turn_rate == pytest.approx(ROBOT.twist(np.array([51.0, -51.0]))[1])
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


@pytest.mark.parametrize('robot', SIDEWAYS)
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


@pytest.mark.parametrize(
    ('robot', 'spread'),
    [(ROBOT, (51.0, 51.0)), (CAR, (40.0, 0.6)), *((each, (16.0,) * 3) for each in SIDEWAYS)],
)
def test_twists_controls_and_wheel_speeds_are_inverse(robot, spread):
    controls = np.random.default_rng(0).uniform(-1.0, 1.0, (50, len(spread))) * spread
    twists, wheels = robot.twist(controls), robot.speeds_of(controls)
    np.testing.assert_allclose(robot.controls(twists), controls, atol=1e-11)
    np.testing.assert_allclose(robot.wheel_speeds(twists), wheels, atol=1e-11)
    np.testing.assert_allclose(robot.twist(controls[0]), twists[0], atol=1e-14)
    np.testing.assert_array_equal(robot.controls(np.zeros(2)), robot.at_rest)
    ordered = controls @ robot.wheels.T
    np.testing.assert_allclose(np.sort(ordered), np.sort(wheels), atol=1e-11)
    if robot is not CAR:
        np.testing.assert_allclose(robot.twist_of_wheels(wheels), twists, atol=1e-12)
        np.testing.assert_array_equal(ordered[:, : len(spread)], controls)


def test_more_controls_than_durations_are_not_driven():
    wheels, held = np.array([[40.0, 30.0], [1.0, 2.0]]), np.array([0.2])
    path = ROBOT.roll_out(np.zeros(3), wheels, held)
    A, B = ROBOT.jacobians(path, wheels, held)
    assert (path.shape, A.shape, B.shape) == ((2, 3), (1, 3, 3), (1, 3, 2))


def test_a_twist_without_speed_to_the_side_is_an_arc_along_the_heading():
    pose, twists = np.array([[1.0, 2.0, 0.4]]), np.array([[0.5, 0.0, 0.3], [-0.5, 0.0, 0.3]])
    for k, forward in enumerate((0.5, -0.5)):
        arc = arc_under(np.repeat(pose, 2, axis=0), twists, k, 0.2)
        known = arc_from(*pose[0], forward * 0.2, 0.3 * 0.2)
        np.testing.assert_allclose((arc.end_x, arc.end_y), (known.end_x, known.end_y), atol=1e-15)
    np.testing.assert_array_equal(plain(twists), twists[:, [0, 2]])
    np.testing.assert_array_equal(with_side(plain(twists)), twists)
    assert speeds_and_turns(np.array([3.0, -4.0, 0.1])).tolist() == [5.0, 0.1]


def test_a_mecanum_robot_turns_its_wheels_as_the_controller_of_ros2_control():
    around = (0.13 + 0.08) * 0.5
    wanted = 0.3 - 0.1 - around, 0.3 + 0.1 + around, 0.3 - 0.1 + around, 0.3 + 0.1 - around
    found = MECANUM.wheel_speeds(np.array([0.3, 0.1, 0.5]))
    np.testing.assert_allclose(found, np.array(wanted) / 0.05)
    limits = MECANUM.twist_limits()
    assert (limits.speed, limits.half_track) == pytest.approx((0.8, 0.21), rel=1e-8)


@pytest.mark.parametrize('robot', SIDEWAYS)
def test_what_is_too_fast_is_slowed_down_along_its_arc_and_never_by_a_bit_too_little(robot):
    for controls in np.random.default_rng(2).normal(size=(500, 3)) * 20.0:
        slowed = robot.limited(controls)
        assert np.abs(robot.speeds_of(slowed)).max() <= 16.0
        np.testing.assert_allclose(np.cross(slowed, controls), 0.0, atol=1e-11)


def test_slip_shortens_the_way():
    controls, held = MECANUM.controls(np.array([[0.4, 0.3, 0.5]])), np.array([0.2])
    slipping, start = MECANUM.slipping(0.1), np.zeros(3)
    found, wanted = (
        slipping.roll_out(start, controls, held),
        MECANUM.roll_out(start, 0.9 * controls, held),
    )
    np.testing.assert_allclose(found, wanted, atol=1e-16)
    np.testing.assert_array_equal(slipping.speeds_of(controls), MECANUM.speeds_of(controls))
    assert MECANUM.slipping(0.0) is MECANUM
    assert slipping.max_speed == pytest.approx(0.9 * MECANUM.max_speed)


def test_braking_is_that_of_the_worst_direction():
    robot = replace(MECANUM, max_wheel_acceleration=20.0)
    assert robot.max_acceleration == pytest.approx(1.0)
    assert robot.braking == pytest.approx(1.0 / math.sqrt(2.0))


def test_a_car_is_steered_and_driven_as_far_as_it_can():
    assert CAR.limited(CAR.controls(np.array([0.01, 5.0])))[1] == 0.6
    assert CAR.limited(CAR.controls(np.array([99.0, 0.0])))[0] == 40.0
    assert CAR.half_track == pytest.approx(2.5 / math.tan(0.6))
    limits, most = CAR.twist_limits(), np.abs(CAR.twist(np.array([40.0, 0.6])))
    assert most == pytest.approx((limits.speed, limits.turn_rate))
    control = np.array([20.0, 0.4])
    np.testing.assert_array_equal(CAR.slowed(control, 0.5), [10.0, 0.4])
    np.testing.assert_array_equal(CAR.stopped(control), [0.0, 0.4])
    assert CAR.steering_of(control) == 0.4
    at_limit = np.array([[10.0 * 0.2, 0.0], [0.0, 0.4 * 0.2]])
    np.testing.assert_allclose(np.abs(at_limit @ CAR.rate_limits.T).max(axis=1), 2.0)


@pytest.mark.parametrize('along', [True, False])
def test_braking_of_a_car_keeps_to_the_arc_and_ends_at_rest(along):
    plan = np.tile([20.0, 0.4], (6, 1))
    ramp = braking(plan, np.full(5, 0.2), 0.2, 2.0, CAR.time_scaling, along=along)
    assert np.abs(np.diff(np.vstack([plan[:1], ramp])[:, 0])).max() <= 2.0 + 1e-9
    assert (ramp[:, 1] == 0.4).all()
    assert ramp[-1, 0] == 0.0


def test_a_ramp_steers_no_faster_than_it_can():
    plan = np.tile([20.0, 0.5], (11, 1))
    commands = within_ramp(plan, np.full(10, 0.2), np.zeros(2), 2.0, CAR.time_scaling)[:-1]
    changes = np.abs(np.diff(np.vstack([np.zeros(2), commands]), axis=0))
    np.testing.assert_allclose(changes[:, 0], 2.0)
    assert changes[:, 1].max() <= 0.4 * 0.2 + 1e-12
    assert commands[-1, 1] == 0.5
