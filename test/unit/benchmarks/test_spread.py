"""Samples in few numbers."""

import numpy as np
import pytest

from benchmarks.families.spread import Spread


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
