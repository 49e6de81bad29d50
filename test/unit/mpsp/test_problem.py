"""Shapes, and the problems that the other tests stand on."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol, assert_derivatives

from cmpsp_ros.mpsp import Dimensions, ProblemError


def test_problems_of_the_tests_have_right_derivatives():
    rng = np.random.default_rng(0)
    assert_derivatives(LinearQuadratic(rng), rng.normal(size=(6, 2)), 'exact')
    problem = VanDerPol(horizon=6, floor=-0.5, mixed=2.0)
    assert_derivatives(problem, rng.normal(size=(7, 1)), 'exact')


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


def test_checked_controls_names_shape_and_stage():
    problem = VanDerPol(horizon=4)
    with pytest.raises(ProblemError, match=r'U: found shape \(4, 1\), wanted \(5, 1\)'):
        problem.checked_controls(np.zeros((4, 1)))
    U = np.zeros((5, 1))
    U[3] = np.nan
    with pytest.raises(ProblemError, match=r'U: found \[nan\] at stage 3'):
        problem.checked_controls(U)
    U[3] = 0.0
    problem.checked_controls(U)


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
