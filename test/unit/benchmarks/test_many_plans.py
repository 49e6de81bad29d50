"""Steps with several plans side by side."""

import pytest

from benchmarks.errors import BenchError
from benchmarks.families.many_plans import measure


def test_as_many_plans_as_asked_in_both_steps():
    told = []
    found = measure(2, (1, 4, 8), lambda: told.append(1))
    assert [each.count for each in found] == [1, 4, 8]
    assert len(told) == 3
    for each in found:
        assert each.first.shape == each.second.shape == (2,)
        assert (each.first > 0.0).all()
        assert (each.second > 0.0).all()


def test_more_plans_than_there_are_ways_is_an_error():
    # Past four obstacles there are sixteen.
    with pytest.raises(BenchError, match='wanted the best of 17 plans'):
        measure(0, (17,))
