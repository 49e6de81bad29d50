"""What proves that there is no solution, and what does not."""

import numpy as np
import pytest
from stage_programs import Sizes, chain, hard, random_program, relaxed, sizes_of

from cmpsp_ros.mpsp.riccati.barrier import EQUAL, HARD
from cmpsp_ros.mpsp.riccati.certificate import proves_infeasible
from cmpsp_ros.mpsp.riccati.interior_point import _COST
from cmpsp_ros.mpsp.riccati.interior_room import interior_room


def proved(qp, penalty, multipliers, of_step=False):
    """The rows that multipliers prove to contradict each other."""
    room = interior_room(*sizes_of(qp))
    model = qp._replace(**{name: getattr(room.model, name) for name in _COST})
    b = room.barrier
    b.kind[:], b.length[:] = HARD, 1.0
    b.kind[: len(qp.output_error)] = EQUAL
    (b.multiplier_step if of_step else b.multiplier)[:] = multipliers
    found = proves_infeasible(qp, model, penalty, room.white, b, room.U, room.conflict)
    return sorted(room.conflict[:found].tolist())


def too_far(bound):
    """To move by 4 in 3 steps of at most ``bound``; rows 0 and 1 + 4 k + 0, 1: bounds."""
    qp = chain(3, 4.0)
    qp.lower[:], qp.upper[:] = -bound, bound
    return qp


@pytest.mark.parametrize('of_step', [False, True])
def test_the_bounds_have_the_multipliers_that_they_need(of_step):
    qp = too_far(1.0)
    multipliers = np.zeros(17)
    multipliers[0] = -1.0
    # The upper bounds of the first three controls; the last control moves nothing.
    assert proved(qp, hard(qp), multipliers, of_step) == [0, 1, 5, 9]
    assert proved(too_far(1.4), hard(qp), multipliers, of_step) == []
    assert proved(qp, relaxed(qp), multipliers, of_step) == []
    assert proved(qp, hard(qp), -multipliers, of_step) == []


def test_rows_that_are_not_needed_are_left_out():
    qp = chain(2, path=2)
    qp.g[1], qp.g_X[1] = 1.0, [[1.0], [-1.0]]
    qp.g_X[2] = 1.0
    multipliers = np.zeros(18)
    multipliers[[6, 7]] = 1e6
    multipliers[12] = 1e-6
    assert proved(qp, hard(qp), multipliers) == [6, 7]
    # With another weight their sum depends on controls that nothing bounds.
    multipliers[7] *= 1.01
    assert proved(qp, hard(qp), multipliers) == []


def test_what_a_solution_meets_is_never_disproved():
    for seed in range(100):
        rng = np.random.default_rng(seed)
        qp = random_program(rng, Sizes(N=4), bound=1.0)
        qp.output_error[:] = 0.0
        # 0 meets all rows.
        for size in (1e-8, 1.0, 1e8):
            multipliers = size * rng.normal(size=2 + 5 * 12) ** 3
            assert proved(qp, hard(qp), multipliers) == []
