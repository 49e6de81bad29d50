"""The Newton step against the weighted program written out."""

import numpy as np
import pytest
from stage_programs import Sizes, dense, random_program, sizes_of

from cmpsp_ros.mpsp.riccati.barrier import HARD
from cmpsp_ros.mpsp.riccati.interior_point import _COST
from cmpsp_ros.mpsp.riccati.interior_room import interior_room
from cmpsp_ros.mpsp.riccati.newton import take_curvature, take_slope, take_step
from cmpsp_ros.mpsp.riccati.stage_qp import propagate


@pytest.mark.parametrize('sizes', [Sizes(), Sizes(N=1, n=1, r=1), Sizes(N=9, n=2, r=3, m=0, l=4)])
def test_the_step_is_the_minimum_of_the_weighted_program(sizes):
    rng = np.random.default_rng(3)
    qp = random_program(rng, sizes, bound=1.0, trust=2.0)
    room = interior_room(*sizes_of(qp))
    model = qp._replace(**{name: getattr(room.model, name) for name in _COST})
    b, white, written = room.barrier, room.white, dense(qp)
    b.kind[:] = HARD
    b.weight[:] = rng.uniform(0.0, 3.0, size=len(b.weight))
    b.miss[:] = rng.normal(size=len(b.miss))
    b.multiplier[:], b.offset[:] = rng.uniform(size=(2, len(b.multiplier)))
    b.slack[:] = 1.0
    room.U[:] = rng.normal(size=room.U.shape)
    propagate(qp, room.U, room.X)
    assert take_curvature(qp, model, white, b)
    for _ in range(2):
        # The second time for another gradient, with the factorisation that is there.
        force = b.multiplier - b.offset + b.weight * b.miss
        H = written.H + written.rows.T @ (b.weight[:, None] * written.rows)
        slope = written.H @ room.U.ravel() + written.c + written.rows.T @ force
        wanted = -np.linalg.solve(H, slope)
        take_slope(qp, model, white, b, room.U, room.X)
        take_step(qp, model, white, b, room.step_U, room.step_X)
        np.testing.assert_allclose(room.step_U.ravel(), wanted, atol=1e-10)
        np.testing.assert_allclose(b.value_step, written.rows @ wanted, atol=1e-10)
        b.miss[:] = rng.normal(size=len(b.miss))
