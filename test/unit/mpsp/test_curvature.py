"""Hessians that have lost their curvature, and what is done about it."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic

from cmpsp_ros.mpsp import QPStatus, condense, convexify, solve_qp
from cmpsp_ros.mpsp.curvature import CURVATURE_LEFT, project_stages
from cmpsp_ros.mpsp.definiteness import (
    is_positive_definite,
    is_positive_definite_along,
    nearest_positive_semidefinite,
)


def program(seed=0, bound=1.0):
    rng = np.random.default_rng(seed)
    problem = LinearQuadratic(rng)
    U = rng.normal(size=(6, 2))
    lin = problem.linearise(problem.predict(U), U)
    return condense(lin, np.full((6, 2), -bound), np.full((6, 2), bound))


def test_a_convex_program_is_left_as_it_is():
    qp = program()
    same, shift = convexify(qp)
    assert same is qp
    assert shift == 0.0


@pytest.mark.parametrize('lowest', [-5.0, -1e-3, 0.0])
def test_the_shift_is_the_least_one(lowest):
    qp = program()
    values, vectors = np.linalg.eigh(qp.H)
    values[0] = lowest
    qp = replace(qp, H=vectors @ np.diag(values) @ vectors.T)
    convex, shift = convexify(qp)
    assert shift == pytest.approx(CURVATURE_LEFT * values[-1] - lowest, rel=1e-9)
    np.testing.assert_allclose(convex.H, qp.H + shift * np.eye(12))
    shifted = np.linalg.eigvalsh(convex.H)
    assert shifted[0] == pytest.approx(CURVATURE_LEFT * values[-1], rel=1e-6)
    assert is_positive_definite(convex.H)
    for name in ('c', 'S_N', 'B_C', 'g', 'lower', 'upper'):
        assert getattr(convex, name) is getattr(qp, name)
    assert solve_qp(convex, 'daqp').status is not QPStatus.FAILED


def test_the_shift_does_not_move_a_fixed_point():
    qp = replace(program(1), c=np.zeros(12), output_error=np.zeros(2))
    qp = replace(qp, g=np.abs(qp.g), H=qp.H - 1.0001 * np.linalg.eigvalsh(qp.H)[0] * np.eye(12))
    convex, shift = convexify(qp)
    assert shift > 0.0
    np.testing.assert_allclose(solve_qp(convex, 'daqp').dU, 0.0, atol=1e-12)


def test_a_cost_without_any_curvature_gets_some():
    qp = program()
    convex, shift = convexify(replace(qp, H=np.zeros((12, 12))))
    assert shift == CURVATURE_LEFT
    np.testing.assert_array_equal(convex.H, CURVATURE_LEFT * np.eye(12))


def test_with_a_closed_form_curvature_along_the_terminal_constraint_is_enough():
    H, S_N = np.eye(12), np.zeros((1, 12))
    H[0, 0], S_N[0, 0] = -1.0, 2.0
    free = np.full(12, np.inf)
    qp = replace(
        program(), H=H, S_N=S_N, output_error=np.ones(1), B_C=np.empty((0, 12)), g=np.empty(0),
        lower=-free, upper=free,
    )  # fmt: skip
    assert convexify(qp) == (qp, 0.0)
    assert convexify(replace(qp, upper=np.ones(12)))[1] > 1.0
    across = np.zeros((1, 12))
    across[0, 1] = 1.0
    assert convexify(replace(qp, S_N=across))[1] > 1.0


def test_what_is_not_finite_is_left_to_the_back_end():
    qp = program()
    H = qp.H.copy()
    H[0, 0] = np.nan
    spoilt = replace(qp, H=H)
    assert convexify(spoilt) == (spoilt, 0.0)
    assert solve_qp(spoilt, 'daqp').status is QPStatus.FAILED


def test_definiteness():
    assert is_positive_definite(np.empty((0, 0)))
    assert is_positive_definite(np.diag([1e-6, 1.0]))
    assert not is_positive_definite(np.diag([1e-12, 1.0]))
    assert not is_positive_definite(np.diag([-1.0, 1.0]))
    assert not is_positive_definite(np.zeros((2, 2)))
    assert not is_positive_definite(np.array([[1.0, np.nan], [np.nan, 1.0]]))
    assert not is_positive_definite(np.array([[np.inf, 0.0], [0.0, 1.0]]))


def test_definiteness_along_a_constraint():
    H = np.diag([-1.0, 1.0, 1.0])
    assert is_positive_definite_along(H, np.array([[1.0, 0.0, 0.0]]))
    assert is_positive_definite_along(H, np.array([[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    assert not is_positive_definite_along(H, np.array([[0.0, 1.0, 0.0]]))
    assert not is_positive_definite_along(H, np.zeros((1, 3)))
    assert not is_positive_definite_along(H, np.empty((0, 3)))
    assert is_positive_definite_along(-H, np.eye(3))
    assert not is_positive_definite_along(H, np.array([[np.nan, 0.0, 0.0]]))
    H[0, 1] = np.inf
    assert not is_positive_definite_along(H, np.array([[1.0, 0.0, 0.0]]))


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
