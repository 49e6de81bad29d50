"""The task of all methods, and control steps by our own."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.loops import close_loop
from benchmarks.methods.ours import CondensedDaqp, FullStep, Law, RiccatiActiveSet
from cmpsp_ros.studies.closed_loop import drive


@pytest.mark.parametrize('steps', [1, 7, 50])
def test_any_number_of_steps_takes_the_same_time(task, steps):
    assert task.durations(steps).sum() == pytest.approx(10.0)
    assert task.guess(steps).shape == (steps + 1, 2)
    X = task.problem(task.pose, task.durations(steps)).predict(task.guess(steps))
    once = task.problem(task.pose, task.durations(1)).predict(task.guess(1))
    np.testing.assert_allclose(X[-1], once[-1], atol=1e-9)


def test_outcome_is_that_of_the_path_itself(task):
    U = task.guess(20)
    outcome = task.outcome(U)
    X = task.settings.robot.roll_out(task.pose, U[:-1], task.durations(20))
    radius = np.linalg.norm(X[:, :2], axis=1)
    assert outcome.cost == pytest.approx(7.5 * np.sum((radius - 10.0) ** 2))
    assert outcome.miss == pytest.approx(np.linalg.norm(X[-1, :2] - task.settings.goal))
    assert outcome.wheel_speed == 45.13


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        ({'miss': 0.5}, 'misses the goal by 0.5 m'),
        ({'miss': np.nan}, 'misses the goal by nan m'),
        ({'violation': 0.02}, 'comes 0.02 m too close'),
        ({'wheel_speed': 52.0}, '52 rad/s, the limit is 51'),
    ],
)
def test_what_does_not_solve_it(task, change, words):
    solved = task.outcome(close_loop(task, CondensedDaqp(task), 8).wheel_speeds)
    assert task.failure(solved) == ''
    assert words in task.failure(replace(solved, **change))


@pytest.mark.parametrize('steps', [7, 50])
def test_two_iterations_are_those_of_the_baseline(task, steps):
    """Warm starts, too: each gets what the other one has made."""
    fast, slow = RiccatiActiveSet(task), CondensedDaqp(task)
    fast.prepare(steps)
    fast.begin(steps)
    U, pose, durations = task.guess(steps), task.pose, task.durations(steps)
    for k in range(3):
        wanted = slow.step(pose, U, durations[k:])
        found = fast.step(pose, U, durations[k:])
        np.testing.assert_allclose(found, wanted, atol=1e-6)
        pose = task.settings.robot.roll_out(pose, found[:1], durations[:1])[-1]
        U = wanted[1:]


STEPS = 50


@pytest.mark.parametrize('make', [FullStep, Law])
def test_it_drives_as_the_law_drives(task, make):
    decisions = list(drive(task.settings, task.pose))[:-1]
    wanted = [decision.wheel_speeds for decision in decisions]
    found = close_loop(task, make(task), STEPS).wheel_speeds
    np.testing.assert_array_equal(found[:-1], wanted)


@pytest.mark.parametrize('make', [FullStep, Law])
def test_horizons_may_change_from_run_to_run(task, make):
    method = make(task)
    first = close_loop(task, method, STEPS).wheel_speeds
    assert len(close_loop(task, method, 2 * STEPS).wheel_speeds) == 2 * STEPS + 1
    np.testing.assert_array_equal(close_loop(task, method, STEPS).wheel_speeds, first)
