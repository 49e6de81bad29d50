"""Samples in few numbers, memory and processor time."""

import numpy as np
import pytest

from benchmarks.common import Spread, resident


def test_known_sample():
    spread = Spread.of(np.arange(1001.0).reshape(7, 143))
    assert (spread.count, spread.median, spread.largest) == (1001, 500.0, 1000.0)
    assert spread.p99 == pytest.approx(990.0)
    assert spread.p999 == pytest.approx(999.0)


@pytest.mark.parametrize(
    ('count', 'p99', 'p999'), [(99, 0, 0), (100, 1, 0), (999, 1, 0), (1000, 1, 1)]
)
def test_percentiles_need_enough_values(count, p99, p999):
    spread = Spread.of(np.ones(count))
    assert (spread.p99 is not None, spread.p999 is not None) == (p99, p999)


def test_of_this_process_it_is_that_of_what_it_holds():
    before = resident()
    held = bytearray(b'x' * 100_000_000)
    grown = resident() - before
    assert len(held) == 100_000_000
    assert 50.0 < grown < 300.0
