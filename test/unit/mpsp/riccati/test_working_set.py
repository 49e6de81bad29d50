"""What one program leaves for the next."""

import numpy as np
import pytest
from stage_programs import Sizes, hint_of, random_program, sizes_of

from cmpsp_ros.mpsp.riccati.rows import BOUND, PATH, TRUST, count_rows, number_of, rows_a_stage
from cmpsp_ros.mpsp.riccati.working_set import active_set, no_hint, shift_hint


@pytest.mark.parametrize('stages', range(8))
@pytest.mark.parametrize('N', [1, 3, 5])
def test_hints_move_to_a_later_horizon(stages, N):
    qp = random_program(np.random.default_rng(0), Sizes(N=6))
    later = random_program(np.random.default_rng(0), Sizes(N=N))
    places = [(PATH, 0, 1), (BOUND, 1, 0), (TRUST, 2, 2), (PATH, 3, 0), (BOUND, 6, 1)]
    numbers = [number_of(qp, *place) for place in places]
    saturated = [-1 - number_of(qp, PATH, k, 0) for k in range(7)]
    hint = hint_of(qp, [1, *numbers, *saturated, -1])
    width = rows_a_stage(qp)
    shift_hint(hint, 2, stages * width, count_rows(later))
    kept = [(kind, k - stages, i) for kind, k, i in places if 0 <= k - stages <= N]
    wanted = [1, *(number_of(later, *place) for place in kept)]
    wanted += [-1 - number_of(later, PATH, k - stages, 0) for k in range(7) if 0 <= k - stages <= N]
    assert hint.rows[: hint.length[0]].tolist() == [*wanted, -1]


def test_there_is_room_for_every_row_in_a_hint():
    qp = random_program(np.random.default_rng(0))
    hint = no_hint(*sizes_of(qp))
    assert hint.length[0] == 0
    assert len(hint.rows) == count_rows(qp)


@pytest.mark.parametrize('capacity', [1, 12, 400])
def test_there_is_room_for_as_many_active_rows_as_controls_or_the_capacity(capacity):
    sizes = Sizes()
    at, most = active_set(*sizes, capacity), min(capacity, (sizes.N + 1) * sizes.r)
    assert at.basis.Q.shape == (most, 12)
    assert len(at.rows) == len(at.multipliers) == len(at.inside) == len(at.conflict) - 1 == most
    assert len(at.states) == len(at.lengths) == count_rows(random_program(np.random.default_rng(0)))
