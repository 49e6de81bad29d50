"""The condensed program against the paper's formulas written out.

That it has the solution of the program with the states kept is tested in `test_clarabel.py`.
"""

import numpy as np
import pytest
from problems import LinearQuadratic, VanDerPol, differences

from cmpsp_ros.mpsp.qp.dense import condense
from cmpsp_ros.mpsp.qp.dense.condensing import sensitivities

SHAPES = [(1, 3, 2, 2, 2), (2, 2, 1, 1, 3), (5, 3, 2, 2, 2), (9, 1, 1, 0, 0), (7, 4, 3, 1, 1)]


def random_program(seed, shape, radius=None):
    rng = np.random.default_rng(seed)
    problem = LinearQuadratic(rng, *shape)
    U = rng.normal(size=problem.control_lower.shape)
    lin = problem.linearise(problem.predict(U), U)
    bound = rng.uniform(0.5, 3.0, size=U.shape)
    return lin, condense(lin, -bound, bound, radius)


def by_recursion(A, B):
    """Recursion (23), literally."""
    steps, n, r = B.shape
    blocks = np.zeros((steps + 1, steps + 1, n, r))
    for k in range(steps + 1):
        phi = np.eye(n)
        for j in range(k - 1, -1, -1):
            blocks[j, k] = phi @ B[j]
            phi = phi @ A[j]
    return blocks


def stacked(lin):
    """``[B]`` of (47) and the block-diagonal matrices (49)-(52)."""
    from scipy.linalg import block_diag

    blocks = by_recursion(lin.A, lin.B)
    big = np.hstack([np.vstack(list(blocks[j])) for j in range(len(blocks))])
    return big, block_diag(*lin.L_XX), block_diag(*lin.L_UX), block_diag(*lin.L_UU)


@pytest.mark.parametrize('shape', SHAPES)
def test_sensitivities_are_those_of_the_recursion(shape):
    lin, _ = random_program(1, shape)
    np.testing.assert_allclose(sensitivities(lin.A, lin.B), by_recursion(lin.A, lin.B), atol=1e-12)


def test_sensitivities_are_derivatives_of_the_roll_out():
    problem = VanDerPol(horizon=12)
    U = np.random.default_rng(2).normal(size=(13, 1))
    lin = problem.linearise(problem.predict(U), U)
    blocks = sensitivities(lin.A, lin.B)
    roll_out = differences(problem.predict, U)
    np.testing.assert_allclose(blocks, roll_out.transpose(2, 0, 1, 3), atol=1e-8)
    assert not blocks[np.triu_indices(13)[::-1]].any()
    assert not blocks[-1].any()


@pytest.mark.parametrize('shape', SHAPES)
@pytest.mark.parametrize('seed', [3, 4])
def test_condensed_matrices_are_the_stacked_ones(shape, seed):
    horizon, n, r = shape[:3]
    lin, qp = random_program(seed, shape, radius=np.full(n, 0.3))
    big, L_XX, L_UX, L_UU = stacked(lin)
    H = big.T @ L_XX @ big + big.T @ L_UX.T + L_UX @ big + L_UU
    np.testing.assert_allclose(qp.H, H, atol=1e-11 * (1.0 + np.abs(H).max()))
    np.testing.assert_array_equal(qp.H, qp.H.T)
    c = lin.L_X.ravel() @ big + lin.L_U.ravel()
    np.testing.assert_allclose(qp.c, c, atol=1e-11 * (1.0 + np.abs(c).max()))

    last = np.zeros((r, len(c)))
    last[:, -r:] = np.eye(r)
    np.testing.assert_allclose(qp.S_N, lin.h_X @ big[-n:] + lin.h_U @ last, atol=1e-11)
    np.testing.assert_array_equal(qp.output_error, lin.output_error)

    row = 0
    for k in range(horizon + 1):
        control = np.zeros((r, len(c)))
        control[:, k * r : (k + 1) * r] = np.eye(r)
        for index in np.flatnonzero(lin.g[k] != -np.inf):
            assert (qp.path_stage[row], qp.path_index[row]) == (k, index)
            expected = lin.g_X[k, index] @ big[k * n : (k + 1) * n] + lin.g_U[k, index] @ control
            np.testing.assert_allclose(qp.B_C[row], expected, atol=1e-11)
            assert qp.g[row] == -lin.g[k, index]
            row += 1
    assert row == len(qp.g) == len(qp.B_C)

    np.testing.assert_allclose(qp.T, big[n:], atol=1e-12)
    np.testing.assert_array_equal(qp.radius, np.full(horizon * n, 0.3))


def test_trust_rows_only_where_the_radius_is_finite():
    _, qp = random_program(6, (4, 3, 2, 2, 2), radius=np.array([np.inf, 0.2, np.inf]))
    assert qp.T.shape == (4, 10)
    np.testing.assert_array_equal(qp.radius, np.full(4, 0.2))
    _, free = random_program(6, (4, 3, 2, 2, 2), radius=np.full(3, np.inf))
    _, none = random_program(6, (4, 3, 2, 2, 2))
    assert free.T.shape == none.T.shape == (0, 10)
    assert free.radius.shape == none.radius.shape == (0,)
