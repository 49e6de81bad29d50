"""Shapes and bounds that are refused, and sentences that a user can read about a run."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol

from cmpsp_ros.mpsp import Dimensions, Evaluation, Options, ProblemError
from cmpsp_ros.mpsp.results import Status, Violation, violations
from cmpsp_ros.mpsp.sqp.solve import solve


def test_the_worst_comes_first():
    g = np.array([[-np.inf, 0.5], [-1.0, 2.0], [0.01, 0.0]])
    found = violations(Evaluation(0.0, np.array([-1.0, 0.05]), g), 0.1, 0.02)
    assert found == (
        Violation(1, 1, False, 2.0),
        Violation(2, 0, True, -1.0),
        Violation(0, 1, False, 0.5),
    )


def test_what_is_not_a_number_is_violated():
    g = np.array([[0.0], [np.nan]])
    (found,) = violations(Evaluation(0.0, np.zeros(1), g), 1e-6, 1e-6)
    assert (found.stage, found.index) == (1, 0)


def test_a_long_list_is_cut():
    problem = VanDerPol(floor=0.6, passes=False, limit=0.1)
    solution = solve(problem, np.zeros((21, 1)), Options(np.zeros(0), np.full(2, 1e3)), 0)
    assert solution.status is Status.ITERATION_LIMIT
    assert len(solution.violated) == 20
    assert solution.sentence.count('is exceeded by') == 4
    assert solution.sentence.endswith('; and 16 more.')
    assert 'Iterations: 0;' in solution.sentence


def test_a_short_list_is_not():
    problem = VanDerPol(goal=(0.4, -0.2))
    solution = solve(problem, np.zeros((21, 1)), Options(np.full(2, 1e3), np.ones(2)), 0)
    assert 'Not met: terminal output' in solution.sentence
    assert 'more' not in solution.sentence


@pytest.mark.parametrize(
    ('sizes', 'named'),
    [
        ((0, 1, 1, 0, 0), 'horizon: found 0, wanted at least 1'),
        ((1, 0, 1, 0, 0), 'state: found 0'),
        ((1, 1, 0, 0, 0), 'control: found 0'),
        ((1, 1, 1, -1, 0), 'output: found -1'),
        ((1, 1, 1, 0, -1), 'path: found -1'),
    ],
)
def test_dimensions_name_what_is_too_small(sizes, named):
    with pytest.raises(ProblemError, match=named):
        Dimensions(*sizes)
    assert Dimensions(1, 1, 1, 0, 0).horizon == 1


def test_linearisation_check_names_every_array():
    problem = LinearQuadratic(np.random.default_rng(1))
    U = np.zeros((6, 2))
    lin = problem.linearise(problem.predict(U), U)
    lin.check(problem.size)
    for name in vars(lin):
        array = getattr(lin, name)
        with pytest.raises(ProblemError, match=f'^{name}: found shape'):
            replace(lin, **{name: array[..., :-1]}).check(problem.size)
        for bad in (np.nan, np.inf):
            spoilt = array.copy()
            spoilt.flat[-1] = bad
            with pytest.raises(ProblemError, match=f'^{name}: found {bad} at '):
                replace(lin, **{name: spoilt}).check(problem.size)


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        (
            {'control_lower': np.zeros((4, 1))},
            r'control_lower: found shape \(4, 1\), wanted \(5, 1\)',
        ),
        ({'control_upper': np.zeros(5)}, r'control_upper: found shape \(5,\), wanted \(5, 1\)'),
        ({'control_upper': np.full((5, 1), np.nan)}, r'control_upper: found nan at \[0, 0\]'),
        (
            {'control_lower': np.full((5, 1), 2.0)},
            r'control_lower: found 2.0 at \[0, 0\], wanted .* 1.0',
        ),
        ({'target': np.zeros(3)}, r'target: found shape \(3,\), wanted \(2,\)'),
        ({'target': np.full(2, np.nan)}, r'target: found \[nan nan\], wanted finite'),
    ],
)
def test_bounds_and_target_are_checked(changes, named):
    problem = VanDerPol(horizon=4, limit=1.0)
    problem.check()
    vars(problem).update(changes)
    with pytest.raises(ProblemError, match=named):
        problem.check()
