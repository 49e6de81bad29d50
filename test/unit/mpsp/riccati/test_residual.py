"""The check of an answer: it sees whatever is wrong with it, and trusts no number that is none."""

import numpy as np
import pytest
from stage_programs import Sizes, empty, find, hard, random_program, relaxed

from cmpsp_ros.mpsp.riccati.outcome import SOLVED
from cmpsp_ros.mpsp.riccati.residual import kkt_residual
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP, propagate

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')


def residual(qp, penalty, dU, multipliers, dX=None):
    if dX is None:
        dX = np.empty((len(dU), qp.state))
        propagate(qp, dU, dX)
    return kkt_residual(qp, penalty, dU, dX, multipliers, np.empty((4, qp.state)))


def changed(multipliers, name, place, by):
    other = getattr(multipliers, name).copy()
    other[place] += by
    return multipliers._replace(**{name: other})


def answer(kind):
    """A program in which every kind of row has a multiplier, and its answer."""
    qp = random_program(np.random.default_rng(0), bound=0.7, trust=1.2)
    qp.g[:] += 0.2
    penalty = kind(qp)
    outcome, room = find(qp, penalty)
    assert outcome == SOLVED
    assert all(part.any() for part in room.multipliers)
    return qp, penalty, room.dU, room.multipliers


KINDS = [hard, lambda qp: relaxed(qp, 1.0, 1.0)]


@pytest.mark.parametrize('kind', KINDS, ids=['hard', 'relaxed'])
def test_a_solution_has_none(kind):
    assert residual(*answer(kind)) < 1e-12


@pytest.mark.parametrize('kind', KINDS, ids=['hard', 'relaxed'])
@pytest.mark.parametrize('by', [0.1, -0.1])
def test_every_part_that_is_wrong_is_seen(kind, by):
    qp, penalty, dU, multipliers = answer(kind)
    for place in np.ndindex(dU.shape):
        other = dU.copy()
        other[place] += by
        assert residual(qp, penalty, other, multipliers) > 1e-4
    for name, array in multipliers._asdict().items():
        for place in np.ndindex(array.shape):
            # The first state is given: a trust region says nothing about it.
            if name == 'trust' and place[0] == 0:
                continue
            wrong = changed(multipliers, name, place, by)
            assert residual(qp, penalty, dU, wrong) > 1e-4, (name, place)


def test_a_multiplier_of_a_row_that_does_not_apply():
    qp = random_program(np.random.default_rng(1))
    qp.g[2, 1] = -np.inf
    qp.g_X[2, 1] = qp.g_U[2, 1] = 0.0
    for penalty in (hard(qp), relaxed(qp)):
        outcome, room = find(qp, penalty)
        assert outcome == SOLVED
        assert residual(qp, penalty, room.dU, room.multipliers) < 1e-12
        wrong = changed(room.multipliers, 'path', (2, 1), 1.0)
        assert residual(qp, penalty, room.dU, wrong) > 1e-2


def test_a_relaxed_row_is_violated_only_at_its_whole_penalty():
    qp, penalty, dU, multipliers = answer(KINDS[1])
    more = Penalty(penalty.terminal, 1.5 * penalty.path)
    assert residual(qp, more, dU, multipliers) > 1e-2
    less = Penalty(penalty.terminal, 0.5 * penalty.path)
    assert residual(qp, less, dU, multipliers) > 1e-2
    assert residual(qp, hard(qp), dU, multipliers) > 1e-2


def test_rows_that_nothing_can_meet():
    qp = empty(2, 1, 1, 1, 1)
    qp.L_UU[:] = 1.0
    qp.output_error[:] = 0.5
    outcome, room = find(qp, relaxed(qp))
    assert outcome == SOLVED
    assert residual(qp, relaxed(qp), room.dU, room.multipliers) < 1e-12
    assert residual(qp, hard(qp), room.dU, room.multipliers) == pytest.approx(0.5)


DATA = [
    (name, bad)
    for name in StageQP._fields
    for bad in (np.nan, np.inf, -np.inf)
    if name not in ('state', 'control')
    # Limits and rows that are not there.
    and (name, bad)
    not in {('upper', np.inf), ('lower', -np.inf), ('trust_radius', np.inf), ('g', -np.inf)}
]


@pytest.mark.parametrize('kind', KINDS, ids=['hard', 'relaxed'])
@pytest.mark.parametrize(('name', 'bad'), DATA)
def test_data_that_are_no_number_have_no_solution(name, bad, kind):
    qp, penalty, dU, multipliers = answer(kind)
    array = getattr(qp, name)
    for place in np.ndindex(array.shape):
        before, array[place] = array[place], bad
        assert np.isnan(residual(qp, penalty, dU, multipliers)), place
        array[place] = before


@pytest.mark.parametrize('kind', KINDS, ids=['hard', 'relaxed'])
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_points_and_multipliers_that_are_no_number_are_no_solution(bad, kind):
    qp, penalty, dU, multipliers = answer(kind)
    dX = np.empty((6, 3))
    propagate(qp, dU, dX)
    for array in (dU, dX, *multipliers):
        for place in np.ndindex(array.shape):
            before, array[place] = array[place], bad
            assert np.isnan(residual(qp, penalty, dU, multipliers, dX)), place
            array[place] = before


def test_penalties_that_are_no_number():
    qp, penalty, dU, multipliers = answer(KINDS[1])
    for array in penalty:
        for place in np.ndindex(array.shape):
            before, array[place] = array[place], np.nan
            assert np.isnan(residual(qp, penalty, dU, multipliers)), place
            array[place] = before


def test_a_program_without_any_rows():
    qp = random_program(np.random.default_rng(2), Sizes(N=1, m=0, l=0))
    outcome, room = find(qp)
    assert outcome == SOLVED
    assert residual(qp, hard(qp), room.dU, room.multipliers) < 1e-13
