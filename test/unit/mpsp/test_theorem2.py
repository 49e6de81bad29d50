"""The conditions of Theorem 2 where they are known to hold, and where each is broken."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol, differences

from cmpsp_ros.mpsp import Options
from cmpsp_ros.mpsp.convergence import Convergence
from cmpsp_ros.mpsp.models.functions import from_functions
from cmpsp_ros.mpsp.qp.dense import condense
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp.solve import solve
from cmpsp_ros.mpsp.theorem2 import Verdict, check, lagrangian_gradient, lagrangian_hessian

YES, NO, CANNOT_TELL = Verdict.YES, Verdict.NO, Verdict.CANNOT_TELL


def solved(problem, guess=None, **changes):
    size = problem.size
    options = Options(np.full(size.output, 1e3), np.full(size.path, 1e3), **changes)
    guess = np.zeros(problem.control_lower.shape) if guess is None else guess
    return solve(problem, guess, options, 200)


def one_step(L, h=None, target=(), g=None, **bounds):
    """``X_1 = X_0 + U_0``; the last control has a cost of its own and does nothing."""
    return from_functions(
        horizon=1,
        x0=np.zeros(2),
        controls=2,
        F=lambda k, x, u: x + u,
        L=lambda k, x, u: L(u) if k == 0 else 0.5 * (u @ u),
        h=h,
        target=None if h is None else target,
        g=g,
        **bounds,
    )


def test_all_hold_at_a_regular_solution():
    problem = VanDerPol(horizon=30, goal=(0.4, -0.2), floor=-0.5, limit=1.0)
    solution = solved(problem, control_tolerance=1e-9)
    assert solution.status is Status.CONVERGED
    found = check(problem, solution, smooth=True)
    assert found.smooth.verdict is YES
    assert found.convex_cost.verdict is CANNOT_TELL
    assert found.convex_cost.figure > 0.0
    assert 'not checked for all U' in found.convex_cost.remark
    assert found.strict_complementarity.verdict is YES
    assert found.regular.verdict is YES
    assert found.second_order.verdict is YES
    assert found.verdict is CANNOT_TELL
    last = solution.history[-1]
    count = len(last.active_path) + len(last.active_bounds)
    assert f'{count} active inequalities' in found.strict_complementarity.remark
    assert f'rank {count + 2} of {count + 2} columns' in found.regular.remark


def test_figures_of_a_linear_quadratic_problem():
    problem = LinearQuadratic(np.random.default_rng(0), path=0)
    solution = solved(problem)
    found = check(problem, solution)
    at = solution.iterate
    free = np.full_like(at.U, np.inf)
    qp = condense(problem.linearise(at.X, at.U), -free, free)
    assert found.smooth.verdict is CANNOT_TELL
    assert found.convex_cost.figure == pytest.approx(np.linalg.eigvalsh(qp.H)[0], rel=1e-9)
    Z = np.linalg.svd(qp.S_N)[2][2:].T
    least = np.linalg.eigvalsh(Z.T @ qp.H @ Z)[0]
    assert found.second_order.figure == pytest.approx(least, rel=1e-6)
    assert found.strict_complementarity.figure is None
    assert found.strict_complementarity.verdict is YES


def test_hessian_of_the_lagrangian_has_all_curvature():
    problem = VanDerPol(horizon=8, goal=(0.4, -0.2), floor=0.1, mixed=1.5)
    solution = solved(problem)
    rho = np.random.default_rng(0).uniform(size=solution.path_multipliers.shape)
    solution = replace(solution, terminal_multipliers=np.array([2.0, -3.0]), path_multipliers=rho)

    def lagrangian(U):
        there = problem.evaluate(problem.predict(U), U)
        g = np.where(np.isfinite(there.g), there.g, 0.0)
        value = there.cost + there.output_error @ (2.0, -3.0) + np.vdot(rho, g)
        return np.array(value)

    U = solution.iterate.U
    gradient = differences(lagrangian, U)
    np.testing.assert_allclose(
        lagrangian_gradient(problem, U, solution), gradient.ravel(), atol=1e-7
    )
    second = differences(lambda U: differences(lagrangian, U, 1e-3), U, 1e-3).reshape(9, 9)
    np.testing.assert_allclose(lagrangian_hessian(problem, solution), second, atol=1e-5)


def test_a_cost_that_curves_downward_somewhere():
    problem = one_step(lambda u: 0.5 * u[0] ** 2 - 0.5 * u[1] ** 2, upper=1.0, lower=-1.0)
    found = check(problem, solved(problem, np.array([[0.0, 0.5], [0.0, 0.0]]), hessian='exact'))
    assert found.convex_cost.verdict is NO
    assert found.convex_cost.figure == pytest.approx(-1.0)
    assert found.second_order.verdict is YES
    assert found.strict_complementarity.figure == pytest.approx(1.0)
    assert found.verdict is NO


def test_an_active_constraint_that_holds_nothing_back():
    problem = one_step(lambda u: 0.5 * (u @ u), g=lambda k, x, u: np.array([u[0]]))
    found = check(problem, solved(problem))
    assert found.strict_complementarity.verdict is NO
    assert found.strict_complementarity.figure == pytest.approx(0.0, abs=1e-9)


def test_a_bound_counts_with_its_sign():
    problem = one_step(lambda u: 0.5 * (u @ u) + 3.0 * u[0] - 2.0 * u[1], lower=-1.0, upper=1.0)
    found = check(problem, solved(problem))
    assert found.strict_complementarity.verdict is YES
    assert found.strict_complementarity.figure == pytest.approx(1.0)
    assert found.regular.verdict is YES
    assert found.regular.figure == pytest.approx(1.0)


@pytest.mark.parametrize('rows', [1, 2])
def test_gradients_that_depend_on_each_other(rows):
    def h(x, u):
        return np.concatenate([x, np.ones(rows) * (x[0] + x[1])])

    problem = one_step(lambda u: 0.5 * (u @ u), h=h, target=[1.0, 2.0, *[3.0] * rows])
    solution = solved(problem)
    found = check(problem, solution)
    assert found.regular.verdict is NO
    assert found.regular.figure < 1e-12
    assert f'rank 2 of {2 + rows} columns' in found.regular.remark


def test_more_gradients_than_controls():
    def h(x, u):
        return np.concatenate([x, u, [x[0] - u[1]]])

    problem = one_step(lambda u: 0.5 * (u @ u), h=h, target=[1.0, 2.0, 0.0, 0.0, 1.0])
    found = check(problem, solved(problem))
    assert found.regular.verdict is NO
    assert found.regular.figure == 0.0
    assert found.second_order.verdict is YES
    assert found.second_order.remark == 'the active constraints leave no direction'


def test_a_saddle_along_the_constraint():
    """On the circle, the point from which the cost falls both ways."""

    def L(u):
        return 0.5 * (u @ u) + u[0]

    problem = one_step(L, h=lambda x, u: np.array([x @ x]), target=[1.0])
    solution = solved(problem, np.array([[1.0, 0.0], [0.0, 0.0]]), method='cmpsp')
    assert solution.status is Status.NOT_A_MINIMUM
    found = check(problem, solution)
    # Multiplier of the circle -1, so 1 - 2 along it.
    assert found.second_order.verdict is NO
    assert found.second_order.figure == pytest.approx(-1.0, abs=1e-6)


def test_a_flat_direction_cannot_be_told():
    problem = one_step(lambda u: 0.5 * u[0] ** 2)
    found = check(problem, solved(problem, hessian='exact'))
    assert found.convex_cost.verdict is NO
    assert found.second_order.verdict is CANNOT_TELL


def test_what_is_no_solution_is_not_judged():
    problem = VanDerPol(goal=(0.4, -0.2))
    found = check(problem, solve(problem, np.ones((21, 1)), Options(np.ones(2), np.ones(2)), 1))
    for part in found.conditions[2:]:
        assert part.verdict is CANNOT_TELL
        assert part.remark.startswith('not converged; ')
    assert found.regular.figure > 0.0


TARGET = np.array([[1.0, -2.0], [0.5, 3.0]])
DIRECTION = np.array([[0.6, 0.0], [0.0, -0.8]])


def sequence(errors, target=TARGET):
    return [SimpleNamespace(U=target + error * DIRECTION) for error in errors]


def geometric(rate, count, first=1.0):
    return first * rate ** np.arange(count)


@pytest.mark.parametrize('rate', [0.1, 0.5, 0.9, 0.994])
@pytest.mark.parametrize('known', [True, False])
def test_rate_of_a_geometric_sequence(rate, known):
    count = {0.1: 9, 0.5: 30, 0.9: 120, 0.994: 1500}[rate]
    found = Convergence.of(sequence(geometric(rate, count, 3.0)), TARGET if known else None)
    assert found.rate == pytest.approx(rate, rel=1e-3 if known else 0.03)
    assert found.interval[0] <= found.rate <= found.interval[1] < 1.0
    assert found.gamma == pytest.approx(3.0, rel=1e-2 if known else 0.9)
    assert f'Q-linear at {found.rate:.3g}' in found.sentence


@pytest.mark.parametrize('seed', range(40))
def test_the_interval_covers_the_rate(seed):
    rng = np.random.default_rng(seed)
    errors = geometric(0.6, 30) * np.exp(0.2 * rng.normal(size=30))
    found = Convergence.of(sequence(errors), TARGET)
    # 95 % of them; the seeds that miss are few and narrow misses.
    width = found.interval[1] - found.interval[0]
    assert found.interval[0] - width < 0.6 < found.interval[1] + width
    assert 0.0 < width < 0.1


def test_the_way_there_does_not_count():
    errors = np.concatenate([np.linspace(10.0, 9.0, 12), geometric(0.5, 30, 8.0)])
    found = Convergence.of(sequence(errors), TARGET)
    assert found.rate == pytest.approx(0.5, rel=1e-6)
    assert found.used[0] >= 12


def test_rounding_does_not_count():
    errors = np.concatenate([geometric(0.1, 12), np.full(30, 3e-13)])
    found = Convergence.of(sequence(errors))
    assert found.rate == pytest.approx(0.1, rel=1e-2)
    assert found.used[-1] < 12


@pytest.mark.parametrize(
    ('errors', 'target', 'reason'),
    [
        ([1.0, 0.5, 0.25], None, '3 iterates are too few'),
        ([1.0, 1e-13, 1e-13, 1e-13, 1e-13], TARGET, '1 errors stand clear'),
        (geometric(1.1, 30), None, 'the steps do not become shorter'),
        (geometric(1.1, 30), TARGET, 'is not known to be below 1'),
        ([1.0, 0.5, 1.0, 0.5, 1.0, 0.5, 1.0], TARGET, 'is not known to be below 1'),
        ([1.0, 0.1, 0.1, 0.1, 0.1], None, 'errors stand clear'),
        ([1.0, 0.1, 0.1, 0.1, 0.01], None, 'the steps do not become shorter'),
    ],
)
def test_cannot_tell(errors, target, reason):
    found = Convergence.of(sequence(errors), target)
    assert found.rate is None
    assert found.interval is None
    assert found.gamma is None
    assert found.used == ()
    assert found.iterations_for(1e-3) is None
    assert found.sentence.startswith('The rate cannot be determined: ')
    assert reason in found.sentence


def test_rate_of_a_run_against_its_own_optimum():
    problem = VanDerPol(goal=(0.4, -0.2), floor=-0.5)
    options = Options(np.full(2, 1e3), np.full(2, 1e3), control_tolerance=1e-10)
    run = solve(problem, np.zeros((21, 1)), options, 60)
    alone = Convergence.of(run.history)
    known = Convergence.of(run.history[:-3], run.iterate.U)
    assert 0.0 < alone.rate < 0.9
    assert alone.interval[0] < known.rate < alone.interval[1] or (
        known.rate == pytest.approx(alone.rate, rel=0.05)
    )
