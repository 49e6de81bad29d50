"""A run that says it has converged is at a local minimum; others say what happened."""

import casadi
import numpy as np
import pytest
from random_problems import fault, random_problem

from cmpsp_ros.mpsp import Options, ProblemError, Status, from_casadi, from_functions, solve


def converged(seeds):
    """Number of problems that converged; fails at one that is no local minimum."""
    count = 0
    for seed in seeds:
        stated, guess = random_problem(seed)
        solution = solve(from_casadi(**stated), guess, max_iterations=150)
        if solution.status is Status.CONVERGED:
            count += 1
            why = fault(stated, solution.iterate.U)
            assert not why, f'problem {seed}: {why}. {solution.sentence}'
    return count


def test_no_wrong_converged():
    assert converged(range(30)) >= 18


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_no_wrong_converged_among_a_thousand():
    assert converged(range(1000)) >= 600


def test_the_check_finds_faults():
    stated, _ = random_problem(0)
    N, r = stated['horizon'], stated['u'].shape[0]
    assert fault(stated, np.full((N + 1, r), 0.21))


def hill(**changes):
    """A cost that curves down: 0 is its maximum."""
    x, u = casadi.SX.sym('x'), casadi.SX.sym('u')
    stated = {'horizon': 2, 'x0': [0.0], 'x': x, 'u': u, 'F': x + u, 'L': -(u**2)}
    return from_casadi(**{**stated, **changes})


def test_a_maximum_is_none():
    solution = solve(hill(), np.zeros((3, 1)), Options(method='cmpsp'))
    assert solution.status is Status.NOT_A_MINIMUM
    assert 'saddle' in solution.sentence


def test_a_maximum_is_left():
    solution = solve(hill(lower=-1.0, upper=2.0), np.zeros((3, 1)))
    assert solution.status is Status.CONVERGED
    assert solution.is_minimum
    assert set(solution.iterate.U.ravel()) <= {-1.0, 2.0}


def test_a_cost_without_bound_is_not_converged():
    solution = solve(hill(), np.ones((3, 1)))
    assert solution.status not in {Status.CONVERGED, Status.ITERATION_LIMIT}


@pytest.mark.parametrize('method', ['cmpsp', 'multiple_shooting', 'auto'])
def test_units_change_neither_answer_nor_iterations(method):
    """A transfer between circular orbits in normalised units, metres, and kilometres and hours."""
    found = []
    for length, gravity in ((1.0, 1.0), (7e6, 3.986e14), (7e3, 3.986e5 * 3600.0**2)):
        time = np.sqrt(length**3 / gravity)
        x, u = casadi.SX.sym('x', 3), casadi.SX.sym('u', 2)

        def rate(s, u=u, gravity=gravity):
            radial = s[2] ** 2 / s[0] - gravity / s[0] ** 2 + u[0]
            return casadi.vertcat(s[1], radial, -s[1] * s[2] / s[0] + u[1])

        h, top = 3.3 * time / 60, 0.5 * length / time**2
        problem = from_casadi(
            horizon=60, x0=[length, 0.0, length / time], x=x, u=u,
            F=x + h * rate(x + 0.5 * h * rate(x)), L=0.5 * h * casadi.sumsqr(u), h=x,
            target=[1.5 * length, 0.0, length / time / np.sqrt(1.5)], lower=-top, upper=top,
        )  # fmt: skip
        solution = solve(problem, np.zeros((61, 2)), Options(method=method))
        assert solution.status is Status.CONVERGED
        found.append((solution.iterate.index, solution.iterate.U / top))
    assert len({index for index, _ in found}) == 1
    for _, U in found[1:]:
        np.testing.assert_allclose(U, found[0][1], atol=1e-6)


@pytest.mark.parametrize(
    ('given', 'message'),
    [
        ({'max_iterations': -1}, 'max_iterations: found -1, wanted at least 0'),
        ({'max_iterations': 1.5}, 'max_iterations: found 1.5, wanted a whole number'),
        ({'time_limit': 0.0}, 'time_limit: found 0.0, wanted a positive number of seconds'),
        ({'options': Options(method='newton')}, "method: found 'newton', wanted one of auto"),
    ],
)
def test_limits_that_do_not_fit_are_named(given, message):
    with pytest.raises(ProblemError, match=message):
        solve(hill(), np.zeros((3, 1)), **given)


def test_progress_is_told_and_time_is_limited():
    stated, guess = random_problem(1)
    told = []
    solution = solve(from_casadi(**stated), guess, progress=told.append)
    assert tuple(told) == solution.history
    hurried = solve(from_casadi(**stated), guess, time_limit=1e-9)
    assert hurried.status is Status.TIME_LIMIT
    assert hurried.iterate.index == 0


def test_errors_of_the_user_pass_through():
    def F(k, x, u):
        return x + 1.0 / 0

    with pytest.raises(ZeroDivisionError):
        from_functions(horizon=2, x0=[0.0], controls=1, F=F, L=lambda k, x, u: u @ u)
