"""The second-order correction: what it undoes, at what cost, and to which order."""

from dataclasses import replace

import numpy as np
import pytest
from problems import VanDerPol
from stage_programs import dense, place, random_program, run

from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPSolution, QPStatus, Subproblem, solve_qp
from cmpsp_ros.mpsp.qp.active_set import correct
from cmpsp_ros.mpsp.qp.active_set.records import borrowed_space, fill, put_solution
from cmpsp_ros.mpsp.qp.active_set.solver import activate
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp.back_end import BackEnd

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')


def after_full_step(seed, N=5, bound=0.7):
    """A solved program with active rows of each kind, and what curvature has made of its rows."""
    rng = np.random.default_rng(seed)
    qp = random_program(rng, N, bound=bound)
    qp.g[:] += 0.2
    found = run(qp)
    assert found.outcome == Outcome.SOLVED
    assert found.multipliers.path.any()
    assert found.multipliers.bounds.any()
    return qp, found, 0.01 * rng.normal(size=2), 0.01 * rng.normal(size=qp.g.shape) - 0.005


def wanted(qp, found, output_error, g):
    """The least change in the metric of the Hessian that meets the rows, by a dense system."""
    written, numbers, excess = dense(qp), list(range(2)), list(output_error)
    for k, j in np.argwhere((found.multipliers.path > 0.0) | (g > 0.0)):
        numbers.append(place(qp, 'path', k, j))
        excess.append(g[k, j])
    fixed = np.eye(len(written.H))[found.multipliers.bounds.ravel() != 0.0]
    rows = np.vstack([written.rows[numbers], fixed])
    excess += [0.0] * len(fixed)
    count = len(rows)
    system = np.block([[written.H, rows.T], [rows, np.zeros((count, count))]])
    right = np.concatenate([np.zeros(len(written.H)), -np.array(excess)])
    return np.linalg.solve(system, right)[: len(written.H)].reshape(qp.lower.shape)


def corrected(found, output_error, g):
    correct(found.space.program, found.space.active, output_error, g)
    return found.space.program.stages['correction_U'].copy()


@pytest.mark.parametrize('seed', [0, 10, 13, 15, 16])
def test_it_is_the_least_change_that_meets_the_rows(seed):
    qp, found, output_error, g = after_full_step(seed)
    least = wanted(qp, found, output_error, g)
    assert np.abs(least).max() > 1e-4
    first = corrected(found, output_error, g)
    np.testing.assert_allclose(first, least, atol=1e-10)
    # The same from the multipliers of any solver.
    assert activate(found.space.program, found.space.active)
    np.testing.assert_allclose(corrected(found, output_error, g), first, atol=1e-10)


def test_controls_that_are_held_stay_there():
    rng = np.random.default_rng(2)
    qp = random_program(rng, 60, bound=0.2)
    qp.g[:], qp.output_error[:] = qp.g - 0.3, 0.1 * qp.output_error
    found = run(qp)
    assert found.outcome == Outcome.SOLVED
    assert found.fixed > 20
    output_error, g = 0.001 * rng.normal(size=2), np.full(qp.g.shape, -0.001)
    found_U = corrected(found, output_error, g)
    assert not found_U[found.space.program.stages['fixed'] != 0.0].any()
    np.testing.assert_allclose(found_U, wanted(qp, found, output_error, g), atol=1e-9)


def second_order_correction(subproblem, solution, output_error, g):
    """The correction of a step by any back end, shape ``(N + 1, r)``."""
    size = subproblem.size
    with borrowed_space(size) as space:
        fill(space, subproblem)
        put_solution(space, solution, subproblem.propagate(solution.dU))
        BackEnd('daqp', 'gauss_newton', space).correct(output_error, g)
        return space.program.stages['correction_U'][:, : size.control].copy()


def value(problem, U):
    return problem.evaluate(problem.predict(U), U)


def program_at(problem, U, **changes):
    """The subproblem of controls without bounds, with some derivatives replaced."""
    linearisation = replace(problem.linearise(problem.predict(U), U), **changes)
    free = np.full(U.shape, np.inf)
    return Subproblem(linearisation, -free, free, np.full(2, np.inf))


def test_a_violation_is_undone_to_second_order():
    """Half the step leaves an eighth of the violation; by itself it would leave a fourth."""
    U = np.full((21, 1), 0.3)
    end = VanDerPol().predict(U)[-1]
    missed, mended = [], []
    # Without a gradient the step goes to 0 with the way to its target.
    flat = {'L_X': np.zeros((21, 2)), 'L_U': np.zeros((21, 1))}
    for length in (0.08, 0.04, 0.02, 0.01):
        problem = VanDerPol(goal=tuple(end + length * np.array([1.0, -0.5])))
        subproblem = program_at(problem, U, **flat)
        solution = solve_qp(subproblem, RICCATI_ACTIVE_SET)
        assert solution.status is QPStatus.SOLVED
        full = value(problem, U + solution.dU)
        bend = second_order_correction(subproblem, solution, full.output_error, full.g)
        missed.append(np.linalg.norm(full.output_error))
        mended.append(np.linalg.norm(value(problem, U + solution.dU + bend).output_error))
    np.testing.assert_allclose(np.divide(missed[:-1], missed[1:]), 4.0, rtol=0.1)
    assert (np.divide(mended[:-1], mended[1:]) > 7.0).all()


def test_without_curvature_there_is_none():
    subproblem = program_at(VanDerPol(horizon=3), np.zeros((4, 1)), L_UU=np.zeros((4, 1, 1)))
    unsolved = QPSolution.unsolved(subproblem.size, QPStatus.FAILED)
    correction = second_order_correction(subproblem, unsolved, np.ones(2), np.ones((4, 2)))
    np.testing.assert_array_equal(correction, np.zeros((4, 1)))
