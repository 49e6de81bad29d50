"""The task of all methods, and what counts as solving it."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.families.timing import close_loop
from benchmarks.methods.condensed_method import CondensedDaqp


@pytest.mark.parametrize('steps', [1, 7, 50])
def test_any_number_of_steps_takes_the_same_time(task, steps):
    assert task.durations(steps).sum() == pytest.approx(10.0)
    assert task.guess(steps).shape == (steps + 1, 2)
    X = task.problem(task.pose, task.durations(steps)).predict(task.guess(steps))
    once = task.problem(task.pose, task.durations(1)).predict(task.guess(1))
    np.testing.assert_allclose(X[-1], once[-1], atol=1e-9)


def test_settings_for_any_number_of_steps(task):
    assert task.settings_for(50) == task.settings
    assert task.settings_for(100).control_period == pytest.approx(0.1)


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
