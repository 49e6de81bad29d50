"""Programs of other sizes."""

import numpy as np
import pytest

from benchmarks.general import SIZES, program
from cmpsp_ros.mpsp.qp import solve_qp


@pytest.mark.parametrize('size', SIZES)
def test_programs_are_solvable_and_have_active_rows(size):
    found = program(1, *size)
    assert (found.size.state, found.size.control) == size
    ours, other = (solve_qp(found, name) for name in ('riccati_active_set', 'daqp'))
    np.testing.assert_allclose(ours.dU, other.dU, atol=1e-7)
    assert np.count_nonzero(ours.bounds) > 0
    assert np.count_nonzero(ours.path) > 0
