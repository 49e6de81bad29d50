"""Eigenvalues told along the stages against those of the condensed Hessian."""

from dataclasses import replace

import numpy as np
import pytest
from problems import LinearQuadratic

from cmpsp_ros.mpsp.qp import spectrum
from cmpsp_ros.mpsp.qp.riccati.fill import is_positive_definite
from cmpsp_ros.mpsp.qp.spectrum import extreme_eigenvalues, largest_diagonal
from cmpsp_ros.mpsp.qp.subproblem import Subproblem


def program(seed, shape=(5, 3, 2, 2, 2), lost=0.0):
    """Random stages with cross terms, less ``lost`` times the identity."""
    rng = np.random.default_rng(seed)
    problem = LinearQuadratic(rng, *shape)
    U = rng.normal(size=problem.control_lower.shape)
    lin = problem.linearise(problem.predict(U), U)
    lin = replace(lin, L_UU=lin.L_UU - lost * np.eye(shape[2]))
    return Subproblem(lin, -np.ones_like(U), np.ones_like(U), np.full(shape[1], np.inf))


@pytest.mark.parametrize('lost', [0.0, 2.0, 1e3])
@pytest.mark.parametrize('shape', [(1, 3, 2, 2, 2), (5, 3, 2, 2, 2), (9, 1, 1, 0, 0)])
@pytest.mark.parametrize('seed', range(3))
def test_they_are_those_of_the_condensed_hessian(seed, shape, lost):
    subproblem = program(seed, shape, lost)
    H = subproblem.condensed.H
    values = np.linalg.eigvalsh(H)
    size = np.abs(values).max()
    np.testing.assert_allclose(
        extreme_eigenvalues(subproblem.stages), values[[0, -1]], atol=1e-13 * size
    )
    assert largest_diagonal(subproblem.stages) == pytest.approx(np.abs(np.diag(H)).max())
    for shift in (-values[0] + 1e-9 * size, -values[0] - 1e-9 * size):
        assert is_positive_definite(subproblem.stages, shift) == (shift > -values[0])
    for shift in (values[-1] + 1e-9 * size, values[-1] - 1e-9 * size):
        assert is_positive_definite(subproblem.stages, shift, -1.0) == (shift > values[-1])


def test_a_hessian_with_nothing_on_its_diagonal():
    """``[[0, 1], [1, 0]]`` in the two controls of one stage, and 0 elsewhere."""
    subproblem = program(0)
    lin = subproblem.linearisation
    L_UU = np.zeros_like(lin.L_UU)
    flat = replace(lin, L_XX=0.0 * lin.L_XX, L_UX=0.0 * lin.L_UX, L_UU=L_UU)
    assert extreme_eigenvalues(replace(subproblem, linearisation=flat).stages) == (0.0, 0.0)
    L_UU[3] = [[0.0, 1.0], [1.0, 0.0]]
    stages = replace(subproblem, linearisation=replace(flat, L_UU=L_UU)).stages
    np.testing.assert_allclose(extreme_eigenvalues(stages), [-1.0, 1.0], atol=1e-12)


@pytest.mark.parametrize('part', ['A', 'B', 'L_XX', 'L_UX', 'L_UU'])
@pytest.mark.parametrize('bad', [np.nan, np.inf])
def test_what_is_not_finite_has_none(part, bad):
    subproblem = program(1)
    spoilt = getattr(subproblem.linearisation, part).copy()
    spoilt[2] = bad
    stages = replace(
        subproblem, linearisation=replace(subproblem.linearisation, **{part: spoilt})
    ).stages
    assert not is_positive_definite(stages, 1.0)
    assert not np.isfinite(extreme_eigenvalues(stages)).all()


# The compiled kernel once more as plain Python, where coverage sees its branches.
def test_the_kernel_says_the_same_uncompiled(monkeypatch):
    stages = program(2).stages
    before = largest_diagonal(stages)
    monkeypatch.setattr(spectrum, '_largest_diagonal', spectrum._largest_diagonal.py_func)
    assert largest_diagonal(stages) == pytest.approx(before, rel=1e-12)
