"""Numbers of rows, and what stands behind each of them."""

import numpy as np
import pytest
from stage_programs import Sizes, dense, random_program, relaxed

from cmpsp_ros.mpsp.riccati.rows import (
    BOUND,
    PATH,
    TRUST,
    count_rows,
    limit_of,
    number_of,
    place_of,
    rows_a_stage,
    value_of,
)

SIZES = [Sizes(), Sizes(N=1, m=0), Sizes(l=0), Sizes(N=3, n=1, r=1, m=0, l=0), Sizes(n=6, r=4, m=3)]


@pytest.mark.parametrize('sizes', SIZES, ids=str)
def test_every_inequality_has_a_number_of_its_own(sizes):
    qp = random_program(np.random.default_rng(0), sizes)
    N, n, r, m, l = sizes  # noqa: E741
    assert rows_a_stage(qp) == l + 2 * r + 2 * n
    numbers = set()
    for k in range(N + 1):
        for kind, components in ((PATH, l), (BOUND, r), (TRUST, n)):
            for component in range(components):
                number = number_of(qp, kind, k, component)
                assert place_of(qp, number) == (kind, k, component, 1.0)
                numbers.add(number)
                if kind != PATH:
                    assert place_of(qp, number + 1) == (kind, k, component, -1.0)
                    numbers.add(number + 1)
    assert numbers == set(range(m, count_rows(qp)))


@pytest.mark.parametrize('sizes', SIZES, ids=str)
def test_values_and_limits_are_those_of_the_rows(sizes):
    rng = np.random.default_rng(1)
    qp = random_program(rng, sizes, bound=1.5, trust=0.7)
    qp.lower[:] -= 0.25
    written, penalty = dense(qp), relaxed(qp, 7.0, 9.0)
    dU = rng.normal(size=qp.lower.shape)
    dX = written.states @ dU.ravel()
    values = written.rows @ dU.ravel()
    assert len(values) == count_rows(qp)
    for row, (value, limit) in enumerate(zip(values, written.limits, strict=True)):
        assert value_of(qp, row, dU, dX) == pytest.approx(value, abs=1e-12)
        found, most = limit_of(qp, penalty, row)
        assert found == limit
        if row < sizes.m:
            assert most == 7.0
        else:
            assert most == (9.0 if place_of(qp, row).kind == PATH else np.inf)


def test_rows_that_do_not_apply_have_no_limit():
    qp = random_program(np.random.default_rng(2))
    qp.g[3, 1] = -np.inf
    assert limit_of(qp, relaxed(qp), number_of(qp, PATH, 3, 1))[0] == np.inf
    assert limit_of(qp, relaxed(qp), number_of(qp, BOUND, 3, 1))[0] == np.inf
    assert limit_of(qp, relaxed(qp), number_of(qp, TRUST, 3, 1) + 1)[0] == np.inf
