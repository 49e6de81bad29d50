"""The check of an answer: it sees whatever is wrong with it, and trusts no NaN."""

import numpy as np
import pytest
from stage_programs import place, random_program, relaxed, run

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
