"""Hessians that have lost their curvature, and what is done about it."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic
from programs import staged

from cmpsp_ros.mpsp import QPStatus, Subproblem, convexify, solve_qp
from cmpsp_ros.mpsp.qp.active_set import records
from cmpsp_ros.mpsp.qp.curvature import (
    CURVATURE_LEFT,
    extreme_eigenvalues,
    largest_diagonal,
    nearest_positive_semidefinite,
    project_stages,
)
from cmpsp_ros.mpsp.qp.dense.closed_form import is_positive_definite


def program(seed=0, shape=(5, 3, 2, 2, 2), lost=0.0):
    """Random stages with cross terms, less ``lost`` times the identity."""
    rng = np.random.default_rng(seed)
    problem = LinearQuadratic(rng, *shape)
    U = rng.normal(size=problem.control_lower.shape)
    lin = problem.linearise(problem.predict(U), U)
    limit, free = np.ones_like(U), np.full(shape[1], np.inf)
    return changed(Subproblem(lin, -limit, limit, free), L_UU=lin.L_UU - lost * np.eye(shape[2]))


def changed(subproblem, **arrays):
    return replace(subproblem, linearisation=replace(subproblem.linearisation, **arrays))


def bent(subproblem, lowest):
    """The program with its least eigenvalue moved, by as much for all of them."""
    least = np.linalg.eigvalsh(subproblem.condensed.H)[0]
    return changed(subproblem, L_UU=subproblem.linearisation.L_UU + (lowest - least) * np.eye(2))


def test_a_convex_program_is_left_as_it_is():
    subproblem = program()
    assert convexify(subproblem) is subproblem
    assert subproblem.shift == 0.0


@pytest.mark.parametrize('lowest', [-5.0, -1e-3, 0.0])
def test_the_shift_is_the_least_one(lowest):
    subproblem = bent(program(), lowest)
    values = np.linalg.eigvalsh(subproblem.condensed.H)
    size = np.abs(values).max()
    convex = convexify(subproblem)
    assert convex.shift == pytest.approx(CURVATURE_LEFT * size - lowest, rel=1e-9)
    before, after = subproblem.condensed, convex.condensed
    np.testing.assert_allclose(after.H, before.H + convex.shift * np.eye(12), atol=1e-12)
    shifted = np.linalg.eigvalsh(after.H)
    assert shifted[0] == pytest.approx(CURVATURE_LEFT * size, rel=1e-6)
    assert is_positive_definite(after.H)
    for name in ('c', 'S_N', 'B_C', 'g', 'lower', 'upper'):
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    assert solve_qp(convex, 'daqp').status is not QPStatus.FAILED


def test_a_cost_without_any_curvature_gets_some():
    qp = replace(program().condensed, H=np.zeros((12, 12)))
    subproblem = staged(qp)
    flat = replace(subproblem.linearisation, L_UU=np.zeros((2, 12, 12)))
    convex = convexify(replace(subproblem, linearisation=flat))
    assert convex.shift == CURVATURE_LEFT
    np.testing.assert_array_equal(convex.condensed.H, CURVATURE_LEFT * np.eye(24))


def test_with_a_closed_form_curvature_along_the_terminal_constraint_is_enough():
    H, S_N = np.eye(12), np.zeros((1, 12))
    H[0, 0], S_N[0, 0] = -1.0, 2.0
    free = np.full(12, np.inf)
    qp = replace(
        program().condensed, H=H, S_N=S_N, output_error=np.ones(1), B_C=np.empty((0, 12)),
        g=np.empty(0), lower=-free, upper=free,
    )  # fmt: skip
    subproblem = staged(qp)
    assert convexify(subproblem) is subproblem
    assert convexify(staged(replace(qp, upper=np.ones(12)))).shift > 1.0
    across = np.zeros((1, 12))
    across[0, 1] = 1.0
    assert convexify(staged(replace(qp, S_N=across))).shift > 1.0


def test_what_is_not_finite_is_left_to_the_back_end():
    subproblem = program()
    L_UU = subproblem.linearisation.L_UU.copy()
    L_UU[0, 0, 0] = np.nan
    spoilt = replace(subproblem, linearisation=replace(subproblem.linearisation, L_UU=L_UU))
    assert convexify(spoilt) is spoilt
    assert solve_qp(spoilt, 'daqp').status is QPStatus.FAILED
    huge = replace(spoilt.linearisation, L_UU=np.full_like(L_UU, 1e308))
    overflowing = replace(subproblem, linearisation=huge)
    assert convexify(overflowing) is overflowing


def test_projection_is_the_nearest():
    rng = np.random.default_rng(2)
    blocks = rng.normal(size=(6, 4, 4))
    blocks = blocks + blocks.transpose(0, 2, 1)
    blocks[0] = blocks[0] @ blocks[0]
    nearest = nearest_positive_semidefinite(blocks)
    np.testing.assert_array_equal(nearest[0], blocks[0])
    assert np.linalg.eigvalsh(nearest).min() > -1e-12
    distance = np.linalg.norm(nearest - blocks, axis=(1, 2))
    for _ in range(200):
        other = nearest + 0.1 * rng.normal(size=blocks.shape)
        other = nearest_positive_semidefinite(other + other.transpose(0, 2, 1))
        assert (np.linalg.norm(other - blocks, axis=(1, 2)) >= distance - 1e-12).all()
    blocks[0, 0, 0] = np.nan
    assert nearest_positive_semidefinite(blocks) is blocks


def test_stages_are_projected_state_and_control_together():
    rng = np.random.default_rng(3)
    joint = rng.normal(size=(5, 5, 5))
    joint = joint + joint.transpose(0, 2, 1)
    parts = project_stages(joint[:, :3, :3], joint[:, 3:, :3], joint[:, 3:, 3:])
    assert [part.shape for part in parts] == [(5, 3, 3), (5, 2, 3), (5, 2, 2)]
    L_XX, L_UX, L_UU = parts
    again = np.block([[L_XX, L_UX.transpose(0, 2, 1)], [L_UX, L_UU]])
    np.testing.assert_allclose(again, nearest_positive_semidefinite(joint), atol=1e-12)
    assert all(part.flags.c_contiguous for part in parts)


@pytest.mark.parametrize('lost', [0.0, 2.0, 1e3])
@pytest.mark.parametrize('shape', [(1, 3, 2, 2, 2), (5, 3, 2, 2, 2), (9, 1, 1, 0, 0)])
@pytest.mark.parametrize('seed', range(3))
def test_they_are_those_of_the_condensed_hessian(seed, shape, lost):
    subproblem = program(seed, shape, lost)
    H = subproblem.condensed.H
    values = np.linalg.eigvalsh(H)
    size = np.abs(values).max()
    np.testing.assert_allclose(extreme_eigenvalues(subproblem), values[[0, -1]], atol=1e-13 * size)
    assert largest_diagonal(subproblem) == pytest.approx(np.abs(np.diag(H)).max())
    for shift in (-values[0] + 1e-9 * size, -values[0] - 1e-9 * size):
        assert records.is_positive_definite(subproblem, shift) == (shift > -values[0])
    for shift in (values[-1] + 1e-9 * size, values[-1] - 1e-9 * size):
        with records.definite_from(subproblem, -1.0) as is_definite:
            assert is_definite(shift) == (shift > values[-1])


def test_a_hessian_with_nothing_on_its_diagonal():
    """``[[0, 1], [1, 0]]`` in the two controls of one stage, and 0 elsewhere."""
    subproblem = program(0)
    L_XX, L_UX, L_UU = np.zeros((6, 3, 3)), np.zeros((6, 2, 3)), np.zeros((6, 2, 2))
    flat = changed(subproblem, L_XX=L_XX, L_UX=L_UX, L_UU=L_UU)
    assert extreme_eigenvalues(flat) == (0.0, 0.0)
    L_UU[3] = [[0.0, 1.0], [1.0, 0.0]]
    np.testing.assert_allclose(extreme_eigenvalues(flat), [-1.0, 1.0], atol=1e-12)


@pytest.mark.parametrize('part', ['A', 'B', 'L_XX', 'L_UX', 'L_UU'])
@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_what_is_not_finite_has_none(part, bad):
    subproblem = program(1)
    spoilt = getattr(subproblem.linearisation, part).copy()
    spoilt[2] = bad
    stages = changed(subproblem, **{part: spoilt})
    assert not records.is_positive_definite(stages, 1.0)
    assert not np.isfinite(extreme_eigenvalues(stages)).all()
