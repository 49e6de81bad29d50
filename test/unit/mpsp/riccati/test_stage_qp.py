"""Programs as arrays, and the sizes that code is told or compiled for."""

import numpy as np
from stage_programs import dense, for_its_sizes, random_program

from cmpsp_ros.mpsp.jit.compiled import compiled
from cmpsp_ros.mpsp.riccati.size import dimension, fixed
from cmpsp_ros.mpsp.riccati.stage_qp import empty_multipliers, empty_qp, propagate


def test_states_follow_the_linearised_dynamics():
    rng = np.random.default_rng(0)
    qp = random_program(rng)
    dU = rng.normal(size=(6, 2))
    for each in (qp, for_its_sizes(qp)):
        dX = np.full((6, 3), np.nan)
        propagate(each, dU, dX)
        np.testing.assert_allclose(dX, dense(qp).states @ dU.ravel(), atol=1e-12)


def test_an_empty_program_asks_nothing():
    qp = empty_qp(4, 3, 2, 1, 5)
    assert dimension(qp.state), dimension(qp.control) == (3, 2)
    assert (qp.lower == -np.inf).all()
    assert (qp.upper == np.inf).all()
    assert (qp.trust_radius == np.inf).all()
    limits = 'lower', 'upper', 'trust_radius', 'state', 'control'
    assert not any(array.any() for name, array in qp._asdict().items() if name not in limits)
    assert all(array.flags.c_contiguous for array in qp[2:])
    assert [part.shape for part in empty_multipliers(4, 3, 2, 1, 5)] == [
        (1,), (5, 5), (5, 3), (5, 2),
    ]  # fmt: skip


@compiled
def number_of(size):
    return dimension(size)


def test_a_size_is_the_same_number_in_compiled_code():
    for size in (1, 3, 12):
        assert dimension(size) == dimension(fixed(size)) == size
        assert number_of(size) == number_of(fixed(size)) == size
