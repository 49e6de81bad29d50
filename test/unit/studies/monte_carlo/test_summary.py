"""Intervals of a study's counts."""

from __future__ import annotations

import pytest

from cmpsp_ros.studies.monte_carlo.summary import Share


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
    assert Share('', count, total).interval == pytest.approx(interval, abs=5e-5)


def test_ends_and_no_runs_at_all():
    assert Share('', 0, 50).interval[0] == pytest.approx(0.0, abs=1e-15)
    assert Share('', 50, 50).interval[1] == pytest.approx(1.0, abs=1e-15)
    assert Share('', 0, 0).interval == (0.0, 1.0)
