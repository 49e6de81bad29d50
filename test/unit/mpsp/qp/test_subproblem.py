"""The subproblem stage by stage against its own condensed program."""

from dataclasses import fields, replace

import numpy as np
import pytest
from problems import LinearQuadratic

from cmpsp_ros.mpsp import Linearisation, Options
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus, Subproblem, kkt_residual
from cmpsp_ros.mpsp.qp.active_set.records import residual_without_step, space
from cmpsp_ros.mpsp.qp.curvature import convexify
from cmpsp_ros.mpsp.qp.dense.closed_form import has_closed_form
from cmpsp_ros.mpsp.sqp import CMPSP

SHAPES = [(1, 3, 2, 2, 2), (5, 3, 2, 2, 2), (9, 1, 1, 0, 0), (7, 4, 3, 1, 1)]


def random_subproblem(shape, seed=0):
    rng = np.random.default_rng(seed)
    problem = LinearQuadratic(rng, *shape)
    U = rng.normal(size=problem.control_lower.shape)
    bound = rng.uniform(0.5, 3.0, size=U.shape)
    radius = np.where(np.arange(shape[1]) % 2, np.inf, 0.7)
    lin = problem.linearise(problem.predict(U), U)
    return problem, Subproblem(lin, -bound, bound, radius)


@pytest.mark.parametrize('shape', SHAPES)
def test_its_functions_are_the_rows_of_the_condensed_program(shape):
    problem, subproblem = random_subproblem(shape)
    assert subproblem.size == problem.size
    qp = subproblem.condensed
    dU = np.random.default_rng(1).normal(size=subproblem.lower.shape)
    dX = subproblem.propagate(dU)
    assert dX.shape == (shape[0] + 1, shape[1])
    assert not dX[0].any()
    held = np.isfinite(subproblem.trust_radius)
    np.testing.assert_allclose(dX[1:, held].ravel(), qp.T @ dU.ravel(), atol=1e-11)
    np.testing.assert_allclose(
        subproblem.terminal(dU, dX), qp.S_N @ dU.ravel() + qp.output_error, atol=1e-11
    )
    g = subproblem.path(dU, dX)
    np.testing.assert_allclose(
        g[qp.path_stage, qp.path_index], qp.B_C @ dU.ravel() - qp.g, atol=1e-11
    )
    assert np.count_nonzero(g != -np.inf) == len(qp.g)


@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_derivatives_that_are_not_finite_are_told(bad):
    _, subproblem = random_subproblem(SHAPES[1])
    lin = subproblem.linearisation
    assert subproblem.linearisation.not_finite == ''
    for field in fields(Linearisation):
        spoilt = getattr(lin, field.name).copy()
        # The last constraint applies at the last stage, and the first at stage 0 does not.
        spoilt.flat[0 if field.name in ('A', 'B') else -1] = bad
        changed = replace(lin, g=np.where(np.arange(6)[:, None] == 5, -1.0, lin.g))
        changed = replace(changed, **{field.name: spoilt})
        assert changed.not_finite.startswith(f'{field.name}: found {bad} at '), field.name
    for name in ('g_X', 'g_U'):
        unused = getattr(lin, name).copy()
        unused[0] = bad
        assert replace(lin, **{name: unused}).not_finite == ''


def test_a_constraint_that_does_not_apply_stays_away_whatever_its_derivatives():
    _, subproblem = random_subproblem(SHAPES[1])
    lin = subproblem.linearisation
    g_U = lin.g_U.copy()
    g_U[0] = np.nan
    subproblem = replace(subproblem, linearisation=replace(lin, g_U=g_U))
    dU = np.ones((6, 2))
    g = subproblem.path(dU, subproblem.propagate(dU))
    np.testing.assert_array_equal(g[0], -np.inf)
    assert np.isfinite(g[lin.g != -np.inf]).all()


@pytest.mark.parametrize('lost', [0.0, 50.0])
def test_a_horizon_whose_condensed_matrices_no_machine_holds(lost):
    """Everything but the dense back ends: 40 000 controls would make a Hessian of 13 GB."""
    problem = LinearQuadratic(np.random.default_rng(3), horizon=20_000)
    problem.A *= 0.4
    options = Options(np.full(2, 1e3), np.full(2, 1e3), trust_radius=np.ones(3))
    iteration = CMPSP(problem, options)
    start = iteration.init(np.zeros((20_001, 2)))
    subproblem = iteration.subproblem(start)
    lin = subproblem.linearisation
    bent = replace(lin, L_UU=lin.L_UU - lost * np.eye(2))
    subproblem = replace(subproblem, linearisation=bent)
    convex = convexify(subproblem)
    assert (convex.shift > 0.0) == (lost > 0.0)
    for each in (subproblem, convex):
        dU = -0.1 * bent.L_U
        dX = each.propagate(dU)
        assert each.linearisation.not_finite == ''
        assert not has_closed_form(each)
        assert (each.path(dU, dX) != -np.inf).sum() == (bent.g != -np.inf).sum()
        solution = replace(QPSolution.unsolved(each.size, QPStatus.SOLVED), dU=dU)
        penalties = Penalties(np.full(2, 1e3), np.full((20_001, 2), 1e3))
        assert kkt_residual(each, solution, penalties) > 1e-5
        residual = residual_without_step(space(each.size), each, *start.multipliers)
        assert 0.0 < residual < np.inf
        assert 'condensed' not in vars(each)
