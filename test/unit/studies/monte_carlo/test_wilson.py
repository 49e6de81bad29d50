"""Wilson's interval against values computed elsewhere and against its own definition."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.studies.monte_carlo.wilson import NORMAL_95, wilson


@pytest.mark.parametrize(
    ('count', 'total', 'interval'),
    [
        # R. G. Newcombe, Two-sided confidence intervals for the single proportion, Stat. Med. 17
        # (1998), table I, method 3.
        (81, 263, (0.2553, 0.3662)),
        (15, 148, (0.0624, 0.1605)),
        (0, 20, (0.0, 0.1611)),
        (1, 29, (0.0061, 0.1718)),
    ],
)
def test_published_values(count, total, interval):
    assert wilson(count, total) == pytest.approx(interval, abs=5e-5)


@given(st.integers(1, 10**6).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_its_ends_are_where_the_normal_test_just_rejects(pair):
    count, total = pair
    low, high = wilson(count, total)
    assert 0.0 <= low <= count / total <= high <= 1.0
    for end in (low, high):
        deviation = abs(count / total - end)
        assert deviation <= NORMAL_95 * math.sqrt(end * (1.0 - end) / total) * (1 + 1e-6) + 1e-12
        if 0.0 < end < 1.0:
            expected = NORMAL_95 * math.sqrt(end * (1.0 - end) / total)
            assert deviation == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_ends_and_no_runs_at_all():
    assert wilson(0, 50)[0] == 0.0
    assert wilson(50, 50)[1] == 1.0
    assert wilson(0, 0) == (0.0, 1.0)
    with pytest.raises(ValueError, match='found 3 of 2'):
        wilson(3, 2)
