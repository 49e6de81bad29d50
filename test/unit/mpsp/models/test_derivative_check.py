"""The check of derivatives finds every wrong entry, and none in what is right."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol

from cmpsp_ros.mpsp import (
    ControlRateProblem,
    OptimalControlProblem,
    ProblemError,
    check_derivatives,
)


class Wrong(OptimalControlProblem):
    """A problem with something added to one entry of one array."""

    def __init__(self, problem, array, place, amount=1e-2):
        self.size, self.target = problem.size, problem.target
        self.control_lower, self.control_upper = problem.control_lower, problem.control_upper
        self.predict, self.evaluate = problem.predict, problem.evaluate
        self.inner, self.array, self.place, self.amount = problem, array, place, amount

    def predict(self, U):
        raise NotImplementedError

    def evaluate(self, X, U):
        raise NotImplementedError

    def linearise(self, X, U, hessian='gauss_newton'):
        lin = self.inner.linearise(X, U, hessian)
        wrong = getattr(lin, self.array).copy()
        wrong[self.place] += self.amount
        return replace(lin, **{self.array: wrong})


def problems():
    rng = np.random.default_rng(0)
    linear = LinearQuadratic(rng)
    linear.applies[1:] = True
    yield linear, rng.normal(size=(6, 2))
    yield VanDerPol(horizon=7, floor=-0.5, mixed=2.0), 0.3 * rng.normal(size=(8, 1))
    yield VanDerPol(horizon=1, passes=False), 0.3 * rng.normal(size=(2, 1))
    rate = ControlRateProblem(VanDerPol(horizon=6), 0.7, np.array([0.3]))
    yield rate, rng.normal(size=(7, 1))


@pytest.mark.parametrize(('problem', 'U'), list(problems()))
def test_what_is_right_passes(problem, U):
    report = check_derivatives(problem, U)
    assert report.is_right, report
    assert report.worst[0].error < 1e-6
    assert [entry.error for entry in report.worst] == sorted(
        (entry.error for entry in report.worst), reverse=True
    )
    assert str(report).startswith('Derivatives agree with differences (worst: ')
    names = {entry.array for entry in report.worst}
    assert {'A', 'B', 'L_X', 'L_U', 'L_XX', 'L_UX', 'L_UU'} <= names
    assert ('h_X' in names) == (problem.size.output > 0)


@pytest.mark.parametrize(
    ('array', 'place', 'stage', 'row', 'column'),
    [
        ('A', (3, 1, 2), 3, 1, 2),
        ('B', (0, 2, 1), 0, 2, 1),
        ('L_X', (2, 1), 2, None, 1),
        ('L_U', (5, 0), 5, None, 0),
        ('L_XX', (4, 2, 0), 4, 2, 0),
        ('L_UX', (1, 1, 2), 1, 1, 2),
        ('L_UU', (0, 0, 1), 0, 0, 1),
        ('h_X', (1, 2), 5, 1, 2),
        ('h_U', (0, 1), 5, 0, 1),
        ('g_X', (2, 1, 0), 2, 1, 0),
        ('g_U', (5, 0, 1), 5, 0, 1),
    ],
)
@pytest.mark.parametrize('amount', [0.01, -3.0, np.nan, np.inf])
def test_a_wrong_entry_is_named(array, place, stage, row, column, amount):
    problem, U = next(problems())
    report = check_derivatives(Wrong(problem, array, place, amount), U)
    assert not report.is_right
    worst = report.worst[0]
    if array in {'L_X', 'L_U'} and not np.isfinite(amount):
        # Then the second derivatives cannot be found, either.
        worst = next(entry for entry in report.worst if entry.array == array)
    assert (worst.array, worst.stage, worst.row, worst.column) == (array, stage, row, column)
    right = getattr(problem.linearise(problem.predict(U), U), array)[place]
    if np.isfinite(amount):
        assert worst.found == pytest.approx(right + amount, abs=1e-12)
        assert worst.by_differences == pytest.approx(right, abs=1e-6)
    else:
        assert worst.error == np.inf
    where = f'{array} at stage {stage}, ' + ('' if row is None else f'row {row}, ')
    assert str(worst).startswith(f'{where}column {column}: found ')
    if worst is report.worst[0]:
        assert str(report).startswith(f'Derivatives differ from differences (worst: {where}')


def test_rows_that_do_not_apply_and_states_that_are_not_reached_are_not_checked():
    problem, U = next(problems())
    for array, place in (('A', (0, 0, 0)), ('g_X', (0, 0, 0)), ('g_U', (0, 1, 0))):
        assert check_derivatives(Wrong(problem, array, place), U).is_right
    # One control reaches one direction of the second state at stage 1: (0, 1) of (x, v).
    oscillator = VanDerPol(horizon=7)
    U = 0.3 * np.random.default_rng(1).normal(size=(8, 1))
    assert check_derivatives(Wrong(oscillator, 'A', (1, 0, 0)), U).is_right
    assert not check_derivatives(Wrong(oscillator, 'A', (1, 0, 1)), U).is_right
    assert not check_derivatives(Wrong(oscillator, 'A', (2, 0, 0)), U).is_right


def test_hessians_may_be_left_out_and_hold_a_proximal_term():
    problem, U = next(problems())
    wrong = Wrong(problem, 'L_UU', (2, 0, 1))
    assert check_derivatives(wrong, U, hessian=None).is_right
    proximal = Wrong(problem, 'L_UU', (slice(None), [0, 1], [0, 1]), 2.0)
    assert not check_derivatives(proximal, U).is_right
    assert check_derivatives(proximal, U, proximal=2.0).is_right


def test_large_costs_do_not_raise_false_alarms():
    problem, U = next(problems())
    problem.W, problem.w = 1e6 * problem.W, 1e6 * problem.w
    assert check_derivatives(problem, U).is_right
    assert not check_derivatives(Wrong(problem, 'L_U', (1, 0), 1e4), U).is_right


def test_bad_input_is_named():
    problem, U = next(problems())
    with pytest.raises(ProblemError, match='U: found shape'):
        check_derivatives(problem, U[1:])
    with pytest.raises(ProblemError, match="hessian: found 'newton'"):
        check_derivatives(problem, U, hessian='newton')
    with pytest.raises(ProblemError, match='tolerance: found 0'):
        check_derivatives(problem, U, tolerance=0.0)
    short = Wrong(problem, 'A', (1, 0, 0))
    short.linearise = lambda X, U, kind: replace(
        problem.linearise(X, U), g_X=problem.linearise(X, U).g_X[1:]
    )
    with pytest.raises(ProblemError, match='g_X: found shape'):
        check_derivatives(short, U)
