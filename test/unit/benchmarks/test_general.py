"""Programs of other sizes."""

import numpy as np
import pytest

from benchmarks.general import SIZES, flops, program
from cmpsp_ros.mpsp.qp import solve_qp


@pytest.mark.parametrize('size', SIZES)
def test_programs_are_solvable_and_have_active_rows(size):
    found = program(1, *size)
    assert (found.size.state, found.size.control) == size
    ours, other = (solve_qp(found, name) for name in ('riccati_active_set', 'daqp'))
    np.testing.assert_allclose(ours.dU, other.dU, atol=1e-7)
    assert np.count_nonzero(ours.bounds) > 0
    assert np.count_nonzero(ours.path) > 0


def test_operations_grow_as_they_should():
    scalar = flops(1, 1, 1, 0, 0, 0)
    assert scalar == pytest.approx(18.0 + 2.0 / 3.0)
    assert flops(100, 6, 3, 0, 0, 0) == pytest.approx(800.0 * flops(1, 3, 1.5, 0, 0, 0))
    # One iteration: half a sweep for the row, one for the states, and one for four constraints.
    assert flops(10, 3, 2, 4, 1, 0) - flops(10, 3, 2, 4, 0, 0) == 10 * (15 + 42 + 40)
    # Beside that two dozen active rows, half of them on average.
    assert flops(10, 3, 2, 4, 1, 24) - flops(10, 3, 2, 4, 1, 0) == 3 * 10 * 2 * 12 + 24**2 / 3
