"""The check of an answer: it sees whatever is wrong with it, and trusts no NaN."""

import numpy as np
import pytest
from stage_programs import chain, place, random_program, relaxed, run, staged

from cmpsp_ros.mpsp.qp import QPSolution, QPStatus
from cmpsp_ros.mpsp.qp import kkt_residual as residual_of
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.qp.riccati.kkt import kkt_residual

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')

SORTS = pytest.mark.parametrize('sort', [lambda _: None, lambda qp: relaxed(qp, 1.0, 1.0)])
# Fields of the records, and which of their values mean that there is no such limit.
STAGE_DATA = {'lower': -np.inf, 'upper': np.inf}
STAGE_DATA |= dict.fromkeys(['A', 'B', 'L_X', 'L_U', 'L_XX', 'L_UX', 'L_UU', 'dU', 'dX'])
ROW_DATA = {'value': None, 'X': None, 'U': None, 'multiplier': None}


def solution(sort):
    """A program in which every kind of row has a multiplier, on its records, and its answer."""
    qp = random_program(np.random.default_rng(0), bound=0.7, trust=1.2)
    qp.g[:] += 0.2
    found = run(qp, sort(qp))
    assert found.outcome == Outcome.SOLVED
    parts = ('terminal', 'path', 'trust', 'bounds')
    assert all(getattr(found.multipliers, part).any() for part in parts)
    p = found.space.program
    assert kkt_residual(p) < 1e-12
    return qp, p


def moved(p):
    """The linearised states of the step."""
    stages = p.stages
    for k in range(len(stages) - 1):
        stages['dX'][k + 1] = stages['A'][k] @ stages['dX'][k] + stages['B'][k] @ stages['dU'][k]


@SORTS
@pytest.mark.parametrize('by', [0.1, -0.1])
def test_every_part_that_is_wrong_is_seen(sort, by):
    _, p = solution(sort)
    for place_ in np.ndindex(p.stages['dU'].shape):
        p.stages['dU'][place_] += by
        moved(p)
        assert kkt_residual(p) > 1e-4
        p.stages['dU'][place_] -= by
        moved(p)
    parts = (
        p.terminal['multiplier'],
        p.path['multiplier'],
        p.stages['bounds'],
        p.stages['trust'][1:],
    )
    for part in parts:
        for where in np.ndindex(part.shape):
            before, part[where] = part[where], part[where] + by
            assert kkt_residual(p) > 1e-4
            part[where] = before
    assert kkt_residual(p) < 1e-12


def test_a_relaxed_row_is_violated_only_at_its_whole_penalty():
    for factor in (1.5, 0.5, np.inf):
        _, p = solution(lambda qp: relaxed(qp, 1.0, 1.0))
        p.path['penalty'] *= factor
        assert kkt_residual(p) > 1e-2


def test_a_row_that_does_not_apply_has_no_multiplier():
    _, p = solution(lambda _: None)
    where = np.argwhere(p.path['multiplier'] == 0.0)[0]
    row = p.path[tuple(where)]
    row['value'], row['X'], row['U'] = -np.inf, 0.0, 0.0
    assert kkt_residual(p) < 1e-12
    row['multiplier'] = 1.0
    assert kkt_residual(p) > 1e-2


@SORTS
@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_no_solution(sort, bad):
    _, p = solution(sort)
    cases = [(p.stages[name], name, limit) for name, limit in STAGE_DATA.items()]
    cases += [(p.stages[name], name, None) for name in ('bounds', 'trust')]
    for rows in (p.terminal, p.path):
        cases += [(rows[name], name, None) for name in ROW_DATA]
    cases.append((p.head['trust_radius'], 'trust_radius', np.inf))
    for array, name, none in cases:
        if bad == none or (name == 'value' and array.ndim == 2 and bad == -np.inf):
            continue
        last = len(array) - 1
        for where in np.ndindex(array.shape):
            # Dynamics beyond the horizon are not used, nor a trust region at the first state.
            if (name in 'AB' and where[0] == last) or (name == 'trust' and where[0] == 0):
                continue
            before, array[where] = array[where], bad
            assert np.isnan(kkt_residual(p)), (name, where)
            array[where] = before
    if np.isnan(bad) and np.isfinite(p.path['penalty']).all():
        p.path['penalty'][2, 1] = bad
        assert np.isnan(kkt_residual(p))


def test_many_held_bounds_have_their_multipliers():
    qp = random_program(np.random.default_rng(1), 80, bound=0.1)
    qp.g[:] -= 1.0
    found = run(qp, relaxed(qp, 2.0, 2.0))
    assert found.outcome == Outcome.SOLVED
    assert found.fixed > 40
    p, held = found.space.program, found.space.program.stages['fixed']
    assert (held * p.stages['bounds'] >= 0.0).all()
    k, a = np.argwhere(held)[7]
    p.stages['bounds'][k, a] *= -1.0
    assert kkt_residual(p) > 1e-4
    assert place(qp, 'bound', k, a, held[k, a]) in found.warm.rows['row'][: found.warm.size]


@pytest.mark.parametrize(
    ('part', 'control', 'multiplier'),
    [('path', 1.0, -1.0), ('terminal', 2.0, -2.0), ('bounds', -1.0, 1.0)],
)
def test_a_stationary_point_is_none_by_one_multiplier_alone(part, control, multiplier):
    """Pulled by a row that pushes, by more than its penalty, or by a bound that is far away."""
    qp = chain(1, 2.0 if part == 'terminal' else None, 1)
    qp.g[0, 0], qp.g_U[0, 0, 0], qp.upper[0, 0] = -1.0 if part == 'path' else -np.inf, 1.0, 5.0
    penalties = relaxed(qp, 1.0) if part == 'terminal' else None
    answer = QPSolution.unsolved(staged(qp).size, QPStatus.SOLVED)
    answer.dU[0, 0] = control
    getattr(answer, part).flat[0] = multiplier
    assert residual_of(staged(qp), answer, penalties) > 0.1
