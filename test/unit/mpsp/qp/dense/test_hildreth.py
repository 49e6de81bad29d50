"""Hildreth's procedure against daqp: hard, relaxed and contradicting programs."""

from dataclasses import replace

import numpy as np
import pytest
from programs import residual_of, solve_rows, uniform

from cmpsp_ros.mpsp import QPStatus
from cmpsp_ros.mpsp.qp.dense import CondensedQP, hildreth


def program(seed, q=12, m=2, p=10, t=4, feasible=True):
    """A random program, of moderate condition, with some bounds missing on either side."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(q, q))
    S_N, B_C, T = (rng.normal(size=(rows, q)) for rows in (m, p, t))
    inside = 0.5 * rng.normal(size=q)
    lower, upper = inside - rng.uniform(0.1, 1.0, q), inside + rng.uniform(0.1, 1.0, q)
    lower[rng.random(q) < 0.3], upper[rng.random(q) < 0.3] = -np.inf, np.inf
    return CondensedQP(
        H=root @ root.T + 0.5 * np.eye(q),
        c=3.0 * rng.normal(size=q),
        S_N=S_N,
        output_error=-S_N @ inside,
        B_C=B_C,
        g=B_C @ inside + (rng.uniform(0.0, 1.0, p) if feasible else -rng.uniform(1.0, 3.0, p)),
        path_stage=np.arange(p),
        path_index=np.zeros(p, dtype=np.int64),
        T=T,
        radius=np.abs(T @ inside) + rng.uniform(0.0, 1.0, t),
        lower=lower,
        upper=upper,
    )


def weights(qp, terminal=20.0, path=10.0):
    return uniform(qp, terminal, path)


def assert_same(found, reference):
    # The accuracy that the module documents.
    size = 1.0 + np.abs(reference.dU).max()
    assert np.abs(found.dU - reference.dU).max() <= 1e-6 * size
    parts = ('terminal', 'path', 'trust', 'bounds')
    scale = 1.0 + max(np.abs(getattr(reference, part)).max(initial=0.0) for part in parts)
    for part in parts:
        wrong = np.abs(getattr(found, part) - getattr(reference, part)).max(initial=0.0)
        assert wrong <= 1e-4 * scale, part


@pytest.mark.parametrize('seed', range(40))
def test_programs_have_daqps_solution(seed):
    """Hard, and relaxed, where half of them have no feasible point."""
    qp = program(seed, feasible=seed % 2 == 0)
    hard, reference = solve_rows(qp, hildreth.solve), solve_rows(qp, 'daqp')
    assert hard.status is reference.status
    if seed % 2 == 0:
        assert hard.status is QPStatus.SOLVED
        assert_same(hard, reference)
        assert residual_of(qp, hard) < 1e-7
        assert 0 < hard.iterations < hildreth.SWEEP_LIMIT
    found, reference = (solve_rows(qp, name, weights(qp)) for name in ('hildreth', 'daqp'))
    assert found.status is reference.status is QPStatus.SOLVED
    assert_same(found, reference)
    assert found.path.max() <= 10.0
    assert np.abs(found.terminal).max() <= 20.0


def contradictions():
    """One program for every pair of kinds of rows that can contradict each other."""
    qp = replace(program(0), lower=np.full(12, -1.0), upper=np.full(12, 1.0))
    far, along = np.zeros((1, 12)), np.zeros((2, 12))
    far[0, 0], along[:, 0] = 1.0, (1.0, -1.0)
    rows = {'path_stage': np.arange(2), 'path_index': np.zeros(2, dtype=np.int64)}
    yield 'two path rows', replace(qp, B_C=along, g=np.array([-0.1, -0.1]), **rows)
    yield 'bound and terminal', replace(qp, S_N=far, output_error=np.array([-2.0]))
    yield (
        'trust and terminal',
        replace(qp, S_N=far, output_error=np.array([-0.5]), T=far, radius=np.array([0.1])),
    )
    yield 'two terminal', replace(qp, S_N=np.vstack([far, far]), output_error=np.array([0.1, -0.1]))
    yield 'nothing moves it', replace(qp, S_N=0.0 * far, output_error=np.ones(1))
    yield 'crossed bounds', replace(qp, lower=qp.upper, upper=qp.lower)


@pytest.mark.parametrize(
    ('name', 'qp'), [pytest.param(*case, id=case[0]) for case in contradictions()]
)
def test_contradictions_are_infeasible_and_may_be_relaxed(name, qp):
    found = solve_rows(qp, hildreth.solve)
    assert found.status is QPStatus.INFEASIBLE
    assert not found.dU.any()
    relaxed = solve_rows(qp, 'hildreth', weights(qp))
    if name == 'crossed bounds':
        # Bounds and trust region are hard in both.
        assert relaxed.status is QPStatus.INFEASIBLE
        return
    assert relaxed.status is QPStatus.SOLVED
    reference = solve_rows(qp, 'clarabel', weights(qp))
    np.testing.assert_allclose(relaxed.dU, reference.dU, atol=1e-5)


def test_hard_rows_that_contradict_each_other_beside_relaxed_ones():
    qp = replace(program(1), lower=np.full(12, -1.0), upper=np.full(12, 1.0))
    T = np.zeros((2, 12))
    T[0, 0], T[1, :2] = 1.0, 1.0
    lower = qp.lower.copy()
    lower[0] = 0.5
    impossible = replace(qp, T=T, radius=np.array([0.1, 3.0]), lower=lower)
    assert solve_rows(impossible, hildreth.solve).status is QPStatus.INFEASIBLE
    assert solve_rows(impossible, hildreth.solve, weights(qp)).status is QPStatus.INFEASIBLE


def test_indefinite_or_not_finite_is_a_failure():
    qp = program(4)
    assert solve_rows(replace(qp, H=-qp.H), hildreth.solve).status is QPStatus.FAILED
    for part in ('H', 'c', 'S_N', 'output_error', 'B_C', 'g', 'T', 'radius', 'lower', 'upper'):
        spoilt = getattr(qp, part).copy()
        spoilt.flat[0] = np.nan
        assert (
            solve_rows(replace(qp, **{part: spoilt}), hildreth.solve).status is QPStatus.FAILED
        ), part
