"""The numbering of rows, and how a program of Python is written into records."""

from dataclasses import replace

import numpy as np
import pytest
from stage_programs import CONTROLS, STATES, dense, place, random_program, relaxed, staged

from cmpsp_ros.mpsp import Dimensions, Linearisation
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.qp.active_set.records import (
    borrowed_space,
    compiled_size,
    fill,
    put_solution,
    solution_in,
    space,
    subproblem_in,
)
from cmpsp_ros.mpsp.qp.riccati.program import (
    RowKind,
    count_rows,
    limit,
    locate,
    row_number,
    row_value,
)
from cmpsp_ros.mpsp.qp.subproblem import QPSolution

KINDS = {each: each.name.lower() for each in RowKind}


def filled(qp, penalties=None):
    return filled_with(staged(qp), penalties)


def filled_with(subproblem, penalties=None):
    mine = space(subproblem.size)
    fill(mine, subproblem, penalties)
    return mine


@pytest.mark.parametrize('sizes', [(5, 2, 2), (1, 0, 3), (3, 1, 0)])
def test_every_row_has_a_number_of_its_own(sizes):
    qp = random_program(np.random.default_rng(0), *sizes)
    program, (N, m, l) = filled(qp).program, sizes  # noqa: E741
    numbers = set()
    for k in range(N + 1):
        for kind, count in ((RowKind.PATH, l), (RowKind.BOUND, CONTROLS), (RowKind.TRUST, STATES)):
            for component in range(count):
                for sign in (1.0,) if kind == RowKind.PATH else (1.0, -1.0):
                    number = row_number(program, kind, k, component, sign)
                    assert number == place(qp, KINDS[kind], k, component, sign)
                    assert locate(program, number) == (kind, k, component, sign)
                    numbers.add(number)
    assert numbers == set(range(m, count_rows(program)))


@pytest.mark.parametrize('penalties', [None, relaxed], ids=['hard', 'relaxed'])
def test_values_and_limits_are_those_of_the_rows(penalties):
    rng = np.random.default_rng(1)
    qp = random_program(rng, bound=1.5, trust=0.7)
    qp.lower[:] -= 0.25
    qp.g[3, 1] = -np.inf
    mine, written = filled(qp, penalties and penalties(qp, 7.0, 9.0)), dense(qp)
    dU = rng.normal(size=qp.lower.shape)
    solution = replace(QPSolution.unsolved(mine.size, QPStatus.SOLVED), dU=dU)
    put_solution(mine, solution, written.states @ dU.ravel())
    values = written.rows @ dU.ravel()
    assert len(values) == count_rows(mine.program)
    for row, (value, wanted) in enumerate(zip(values, written.limits, strict=True)):
        assert row_value(mine.program, row) == pytest.approx(value, abs=1e-12)
        upper = 7.0 if row < 2 else 9.0 if locate(mine.program, row)[0] == RowKind.PATH else np.inf
        assert limit(mine.program, row) == (wanted, upper if penalties else np.inf)


def test_a_program_is_filled_up_to_a_compiled_size():
    assert compiled_size(3, 2) == (3, 2)
    assert compiled_size(1, 1) == compiled_size(4, 2) == (5, 2)
    assert compiled_size(3, 3) == compiled_size(6, 1) == (6, 3)
    assert compiled_size(4, 4) == compiled_size(7, 1) == (8, 4)
    assert compiled_size(9, 1) == (16, 8)
    assert compiled_size(65, 1) == (65, 1)
    mine = space(Dimensions(4, 2, 1, 1, 1))
    assert mine.program.stages['A'].shape == (5, 5, 5)
    # Nothing moves what fills up, and it costs only itself.
    np.testing.assert_array_equal(mine.program.stages['L_UU'][:, 1:, 1:], [np.eye(1)] * 5)
    assert not mine.program.stages['B'].any()


def test_a_solution_put_in_comes_back():
    qp, rng = random_program(np.random.default_rng(2)), np.random.default_rng(3)
    mine = filled(qp)
    shapes = (6, 2), (2,), (6, 2), (6, 3), (6, 2)
    solution = QPSolution(QPStatus.SOLVED, *(rng.normal(size=shape) for shape in shapes))
    put_solution(mine, solution, rng.normal(size=(6, 3)))
    np.testing.assert_equal(vars(solution_in(mine)), vars(solution))


def test_a_program_put_in_comes_back():
    qp = staged(random_program(np.random.default_rng(2), bound=1.0, trust=2.0))
    found = subproblem_in(filled_with(qp))
    np.testing.assert_equal(vars(found.linearisation), vars(qp.linearisation))
    for name in ('lower', 'upper', 'trust_radius'):
        np.testing.assert_array_equal(getattr(found, name), getattr(qp, name))


def test_arrays_of_any_kind_are_taken():
    """Read-only, in the other order, or of whole numbers."""
    qp = staged(random_program(np.random.default_rng(2)))
    odd = {name: np.asfortranarray(array) for name, array in vars(qp.linearisation).items()}
    odd['h_U'] = np.ones((2, 2), dtype=int)
    given = replace(qp, linearisation=Linearisation(**odd), lower=np.broadcast_to(-1.0, (6, 2)))
    found = subproblem_in(filled_with(given))
    np.testing.assert_equal(vars(found.linearisation), odd)
    np.testing.assert_array_equal(found.lower, -1.0)


def test_borrowed_memory_is_nobody_elses_meanwhile():
    # No other test has programs of this size.
    size = Dimensions(17, 3, 2, 1, 1)
    with borrowed_space(size) as one, borrowed_space(size) as other:
        assert one is not other
    with borrowed_space(size) as again:
        assert again in (one, other)
