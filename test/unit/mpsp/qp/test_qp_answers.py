"""Checks of every answer, and Clarabel's answers where the active set gives up."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic
from stage_programs import random_program, relaxed
from stage_programs import staged as staged_program

from cmpsp_ros.mpsp import Linearisation
from cmpsp_ros.mpsp.qp import (
    Penalties,
    QPStatus,
    Subproblem,
    available,
    kkt_residual,
    no_warm_start,
    solve_from,
    solve_qp,
)
from cmpsp_ros.mpsp.qp.active_set.state import CAPACITY
from cmpsp_ros.mpsp.qp.dense import solve_by_daqp

BACKENDS = available()


def test_an_answer_that_is_no_solution_is_not_believed():
    """A limit that no control reaches, at a price that is too high for daqp to see the others."""
    qp = random_program(np.random.default_rng(3), 12, bound=0.1)
    qp.g[:], qp.output_error[:] = -np.inf, 0.0
    qp.g[7, 0] = 1e3
    program, prices = staged_program(qp), relaxed(qp)
    claimed = solve_by_daqp(program, prices)
    assert claimed.status is QPStatus.SOLVED
    assert kkt_residual(program, claimed, prices) > 0.1
    assert solve_qp(program, 'daqp', prices).status is QPStatus.FAILED


def general(seed=0):
    """A subproblem with everything in it, and penalties under which some of its rows give."""
    rng = np.random.default_rng(seed)
    problem = LinearQuadratic(rng)
    U = rng.normal(size=(6, 2))
    subproblem = Subproblem(
        problem.linearise(problem.predict(U), U),
        np.full((6, 2), -0.8),
        np.full((6, 2), 0.9),
        np.array([np.inf, 0.6, 1.4]),
    )
    return subproblem, Penalties(np.array([30.0, 2.0]), rng.uniform(1.0, 20.0, size=(6, 2)))


@pytest.mark.parametrize('name', BACKENDS)
@pytest.mark.parametrize('seed', range(3))
def test_answers_are_in_the_shapes_of_the_stages(name, seed):
    subproblem, penalties = general(seed)
    solution = solve_qp(subproblem, name, penalties)
    assert solution.status is QPStatus.SOLVED
    assert solution.conflict == ()
    dX = subproblem.propagate(solution.dU)
    g = subproblem.path(solution.dU, dX)
    assert solution.path.shape == g.shape == (6, 2)
    assert (np.abs(solution.path[g < -1e-4]) < 1e-4).all()
    assert (solution.path[g == -np.inf] == 0.0).all()
    np.testing.assert_allclose(solution.path[g > 1e-4], penalties.path[g > 1e-4], atol=1e-3)
    # Multipliers beyond a solver's own rounding are at the limit that they are signed as.
    for part, at, least, largest in (
        (solution.bounds, solution.dU, subproblem.lower, subproblem.upper),
        (solution.trust, dX, -subproblem.trust_radius, subproblem.trust_radius),
    ):
        assert part.shape == at.shape
        limit = np.where(part > 0.0, largest, least)
        pulls = np.abs(part) > 1e-3
        assert pulls.any()
        np.testing.assert_allclose(at[pulls], limit[pulls], atol=1e-5)


def test_arrays_of_any_kind_are_taken():
    """Read-only, in the other order, or of whole numbers."""
    subproblem, penalties = general()
    lin = replace(subproblem.linearisation, h_U=np.ones((2, 2)))
    odd = {name: np.asfortranarray(array) for name, array in vars(lin).items()}
    odd['h_U'] = np.ones((2, 2), dtype=int)
    strange = replace(
        subproblem, linearisation=Linearisation(**odd), lower=np.broadcast_to(-0.8, (6, 2))
    )
    wanted = solve_qp(replace(subproblem, linearisation=lin), 'riccati_active_set', penalties)
    assert wanted.status is QPStatus.SOLVED
    found = solve_qp(strange, 'riccati_active_set', penalties)
    np.testing.assert_array_equal(found.dU, wanted.dU)


def written_out(subproblem, solution, penalties):
    """Stationarity, feasibility, signs and slackness of the condensed program, by its matrices."""
    qp = subproblem.condensed
    rows = qp.path_stage, qp.path_index
    dU, bounds, rho = solution.dU.ravel(), solution.bounds.ravel(), solution.path[rows]
    trust = solution.trust[1:, np.isfinite(subproblem.trust_radius)].ravel()
    pull = qp.S_N.T @ solution.terminal + qp.B_C.T @ rho + qp.T.T @ trust
    parts = qp.H @ dU + qp.c, pull, bounds
    scale, size = 1.0 + max(np.abs(part).max() for part in parts), 1.0 + np.abs(dU).max()
    terminal, path = qp.S_N @ dU + qp.output_error, qp.B_C @ dU - qp.g
    outside = qp.T @ dU * np.sign(trust) - qp.radius
    reach = np.where(bounds > 0.0, dU - qp.upper, qp.lower - dU)
    hard = [np.abs(qp.T @ dU) - qp.radius, qp.lower - dU, dU - qp.upper]
    signs = [-rho]
    gaps = [trust * outside, bounds * reach]
    if penalties is None:
        hard += [np.abs(terminal), path]
        gaps += [rho * path]
    else:
        most = penalties.path[rows]
        signs += [rho - most, np.abs(solution.terminal) - penalties.terminal]
        gaps += [rho * np.minimum(path, 0.0), np.maximum(path, 0.0) * (most - rho)]
        gaps += [np.abs(terminal) * penalties.terminal - terminal * solution.terminal]
    return max(
        np.abs(sum(parts)).max() / scale,
        *(part.max() / size for part in hard),
        *(part.max() / scale for part in signs),
        *(np.abs(part).max() / (scale * size) for part in gaps),
    )


@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('relaxed', [False, True])
def test_the_residual_is_that_of_the_condensed_program(seed, relaxed):
    subproblem, penalties = general(seed)
    penalties = penalties if relaxed else None
    solution = solve_qp(subproblem, 'daqp', general(seed)[1])
    rng = np.random.default_rng(seed)
    applies = subproblem.linearisation.g != -np.inf
    held = np.isfinite(subproblem.trust_radius) & (np.arange(6) > 0)[:, None]
    for spread in (0.0, 1e-3, 1.0):
        noise = {
            part: spread * rng.normal(size=getattr(solution, part).shape)
            for part in ('dU', 'terminal', 'path', 'trust', 'bounds')
        }
        noise['path'] *= applies
        noise['trust'] *= held
        moved = replace(solution, **{part: getattr(solution, part) + noise[part] for part in noise})
        wanted = written_out(subproblem, moved, penalties)
        found = kkt_residual(subproblem, moved, penalties)
        assert found == pytest.approx(wanted, rel=1e-9, abs=1e-13)
        assert spread == 0.0 or found > 1e-5


def crowded(N):
    """Two carts side by side, which hurry as their forces allow, and hardly need to stop."""
    K = N + 1
    derivatives = Linearisation(
        A=np.tile(np.eye(2), (N, 1, 1)),
        B=np.tile(np.eye(2), (N, 1, 1)),
        L_X=np.tile([-1.0, -2.0], (K, 1)),
        L_U=np.zeros((K, 2)),
        L_XX=np.zeros((K, 2, 2)),
        L_UX=np.zeros((K, 2, 2)),
        L_UU=np.tile(np.eye(2), (K, 1, 1)),
        output_error=np.empty(0),
        h_X=np.empty((0, 2)),
        h_U=np.empty((0, 2)),
        g=np.empty((K, 0)),
        g_X=np.empty((K, 0, 2)),
        g_U=np.empty((K, 0, 2)),
    )
    return Subproblem(derivatives, np.full((K, 2), -1.0), np.full((K, 2), 1.0), np.full(2, np.inf))


def test_more_active_bounds_than_there_is_capacity_for():
    """They are held, and need none."""
    subproblem = crowded(CAPACITY // 2 + 10)
    warm = no_warm_start(subproblem.size)
    for _ in range(2):
        solution = solve_from(subproblem, None, warm)
        assert solution.status is QPStatus.SOLVED
        assert np.count_nonzero(solution.bounds) > CAPACITY
        assert kkt_residual(subproblem, solution, None) < 1e-8
        np.testing.assert_allclose(solution.dU[:-2], 1.0, atol=1e-10)
        assert warm.size == np.count_nonzero(solution.bounds)


def test_more_other_rows_than_there_is_capacity_for():
    """Speed limits, as path rows that are active on all stages."""
    subproblem = crowded(CAPACITY // 2 + 10)
    stages, free = subproblem.size.horizon + 1, np.full_like(subproblem.upper, np.inf)
    lin = replace(
        subproblem.linearisation,
        g=np.full((stages, 2), -1.0),
        g_X=np.zeros((stages, 2, 2)),
        g_U=np.tile(np.eye(2), (stages, 1, 1)),
    )
    program = Subproblem(lin, -free, free, subproblem.trust_radius)
    warm = no_warm_start(program.size)
    solution = solve_from(program, None, warm)
    assert solution.status is QPStatus.SOLVED
    np.testing.assert_allclose(solution.dU[:-2], 1.0, atol=1e-7)
    assert warm.size == 0
