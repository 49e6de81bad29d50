"""Commands that wheels of limited acceleration can follow, and how they come to rest."""

import math

import numpy as np
import pytest

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.robots.motion import braking, with_lag, within_ramp

ROBOT, LIMIT, PERIOD = DifferentialDrive(), 6.0, 0.2


def changes(commands, previous):
    return np.abs(np.diff(np.vstack([previous, commands]), axis=0)).max(initial=0.0)


def plans(count=40, steps=30):
    """Plans whose wheels keep the limit, and others that do not."""
    rng = np.random.default_rng(1)
    for index in range(count):
        most = LIMIT if index % 2 else 40.0
        plan = np.cumsum(rng.uniform(-most, most, (steps + 1, 2)), axis=0)
        yield np.clip(plan, -50.0, 50.0), rng.uniform(0.1, 0.3, steps), rng.uniform(-20, 20, 2)


def test_a_plan_that_can_be_followed_stays_as_it_is():
    for plan, durations, _ in list(plans())[1::2]:
        kept = within_ramp(plan, durations, plan[0], LIMIT)
        np.testing.assert_array_equal(kept, plan)


def test_without_a_limit_every_plan_does():
    for plan, durations, previous in plans():
        assert within_ramp(plan, durations, previous, math.inf) is plan


def test_no_wheel_changes_by_more_than_the_limit():
    for plan, durations, previous in plans():
        commands = within_ramp(plan, durations, previous, LIMIT)
        assert commands.shape == plan.shape
        assert changes(commands[:-1], previous) <= LIMIT + 1e-12
        assert np.abs(commands).max() <= max(np.abs(plan).max(), np.abs(previous).max())


def test_from_rest_the_same_path_is_driven():
    steps = 50
    plan = np.tile([30.0, 20.0], (steps + 1, 1))
    commands = within_ramp(plan, np.full(steps, PERIOD), np.zeros(2), LIMIT)
    np.testing.assert_allclose(commands[0], [6.0, 4.0])
    np.testing.assert_allclose(commands[:, 0] / commands[:, 1], 1.5)
    np.testing.assert_array_equal(commands[5:], plan[5:])


@pytest.mark.parametrize('along', [True, False])
def test_braking_ends_at_rest_and_keeps_the_limit(along):
    for plan, durations, _ in plans():
        ramp = braking(plan, durations, PERIOD, LIMIT, along=along)
        np.testing.assert_array_equal(ramp[-1], [0.0, 0.0])
        assert not np.signbit(ramp[-1]).any()
        assert changes(ramp, plan[0]) <= LIMIT + 1e-9
        assert np.any(ramp[:-1], axis=1).all()


def test_braking_along_a_curvature_keeps_it():
    plan = np.array([[30.0, 20.0], [-5.0, 9.0], [0.0, 0.0]])
    ramp = braking(plan, np.full(2, PERIOD), PERIOD, LIMIT, along=False)
    assert len(ramp) == 5
    np.testing.assert_allclose(ramp[:-1, 0] / ramp[:-1, 1], 1.5)


def test_braking_along_a_plan_stays_near_its_path():
    """A bend that comes after the first command is driven through."""
    steps = 40
    plan = np.tile([40.0, 40.0], (steps + 1, 1))
    plan[2:4], plan[4:6] = [44.0, 36.0], [36.0, 44.0]
    durations, start = np.full(steps, PERIOD), np.zeros(3)
    path = ROBOT.roll_out(start, plan[:-1], durations)
    distances = {}
    for along in (True, False):
        ramp = braking(plan, durations, PERIOD, LIMIT, along=along)
        commands = np.vstack([plan[:1], ramp])
        end = ROBOT.roll_out(start, commands, np.full(len(commands), PERIOD))[-1]
        fine = ROBOT.roll_out(start, np.repeat(plan[:-1], 50, axis=0), np.full(2000, PERIOD / 50))
        distances[along] = np.hypot(*(fine[:, :2] - end[:2]).T).min()
    assert np.hypot(*path[-1, :2]) > 5.0
    assert distances[True] < 0.03
    assert distances[False] > 2.0 * distances[True]


def test_a_robot_at_rest_has_nothing_to_brake():
    plan = np.vstack([np.zeros((1, 2)), np.full((3, 2), 5.0)])
    assert len(braking(plan, np.full(3, PERIOD), PERIOD, LIMIT, along=True)) == 0


def test_wheels_that_lag_turn_as_far_as_the_exact_response():
    wheels, lag = np.array([5.0, -3.0]), 0.2
    commands, held = np.array([[20.0, 10.0], [0.0, 12.0]]), np.array([0.2, 0.3])
    exact, turned = wheels.copy(), np.zeros(2)
    for command, time in zip(commands, held, strict=True):
        decay = math.exp(-time / lag)
        turned += command * time + (exact - command) * lag * (1.0 - decay)
        exact = command + (exact - command) * decay
    means, durations = with_lag(wheels, commands, held, lag, 5)
    assert len(means) == len(durations) == 10
    np.testing.assert_allclose(means.T @ durations, turned)
    np.testing.assert_allclose(wheels, exact)
