"""Where the active set gives up, Clarabel has the answer."""

from dataclasses import replace

import numpy as np
import pytest
from programs import contradicting, penalties, program, solve_rows

from cmpsp_ros.mpsp import Linearisation
from cmpsp_ros.mpsp.qp import (
    QPStatus,
    Subproblem,
    back_ends,
    kkt_residual,
    no_warm_start,
    solve_from,
)
from cmpsp_ros.mpsp.qp.active_set.state import CAPACITY
from cmpsp_ros.mpsp.qp.dense import clarabel_backend
from cmpsp_ros.mpsp.qp.riccati import Outcome


@pytest.fixture
def asked(monkeypatch):
    """How often Clarabel was asked."""
    calls = []

    def solve(subproblem, penalties):
        calls.append(subproblem)
        return own(subproblem, penalties)

    own = clarabel_backend.solve
    monkeypatch.setattr(clarabel_backend, 'solve', solve)
    return calls


@pytest.fixture
def stopped(monkeypatch):
    """An active-set method that gives up."""
    monkeypatch.setattr(back_ends, 'solve_program', lambda *_: Outcome.ITERATION_LIMIT)


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


def test_the_active_set_answers_itself_where_it_can(asked):
    assert solve_rows(program(), 'riccati_active_set').status is QPStatus.SOLVED
    assert asked == []


def test_a_proof_needs_no_second_opinion(asked):
    assert solve_rows(contradicting(), 'riccati_active_set').status is QPStatus.INFEASIBLE
    assert asked == []


def test_rows_that_contradict_each_other_without_a_proof_are_tried_alone(asked):
    """They can be met, by controls of 1e5 that the active-set method takes for rounding."""
    subproblem = crowded(1)
    lin, free = subproblem.linearisation, np.full_like(subproblem.upper, np.inf)
    outputs = replace(
        lin,
        output_error=np.array([-3.0, -3.00001]),
        h_X=np.array([[1.0, 0.0], [1.0, 0.0]]),
        h_U=np.array([[0.0, 0.0], [1e-10, 0.0]]),
    )
    solve_from(
        Subproblem(outputs, -free, free, subproblem.trust_radius),
        None,
        no_warm_start(replace(subproblem.size, output=2)),
    )
    alone, whole = asked[0], asked[-1]
    assert not np.isfinite(alone.lower).any()
    assert len(alone.linearisation.output_error) == len(whole.linearisation.output_error) == 2


@pytest.mark.parametrize('seed', range(4))
def test_an_active_set_that_gives_up_leaves_it_to_clarabel(asked, stopped, seed):
    qp = program(seed)
    for weights in (None, penalties(qp)):
        found = solve_rows(qp, 'riccati_active_set', weights)
        reference = solve_rows(qp, 'daqp', weights)
        assert found.status is reference.status is QPStatus.SOLVED
        np.testing.assert_allclose(found.dU, reference.dU, atol=1e-6)
    assert len(asked) == 2


def test_more_active_bounds_than_there_is_capacity_for(asked):
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
    assert asked == []


def test_more_other_rows_than_there_is_capacity_for(asked):
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
    assert len(asked) == 1
    assert warm.size == 0
