"""Smooth lines through points."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.world.roads.center_line import fit, sample

CIRCLE = 5.0 * np.array([(math.cos(a), math.sin(a)) for a in np.arange(24) * math.tau / 24])
BEND = np.array([(0.0, 0.0), (1.0, 0.2), (2.5, 1.0), (3.0, 2.5), (3.1, 4.0)])


def at(line, progress, order=0):
    """Position, or a derivative of it, at a progress."""
    i = min(max(np.searchsorted(line.knots, progress, 'right') - 1, 0), len(line.pieces) - 1)
    t = progress - line.knots[i]
    return np.array(
        [
            np.polynomial.Polynomial(line.pieces[i, 4 * which : 4 * which + 4]).deriv(order)(t)
            for which in range(2)
        ]
    )


def fitted(points, width=1.0, *, closed):
    widths = np.broadcast_to(np.asarray(width, float), len(points))
    return fit(points, widths, widths, closed=closed)


@pytest.mark.parametrize('closed', [True, False])
def test_it_passes_through_the_points_in_order(closed):
    points = CIRCLE if closed else BEND
    line = fitted(points, closed=closed)
    knots = line.knots if closed else line.knots[1:-1]
    for knot, point in zip(knots, points, strict=False):
        np.testing.assert_allclose(at(line, knot), point, atol=1e-12)


@pytest.mark.parametrize('closed', [True, False])
def test_two_derivatives_are_continuous_and_the_parameter_is_the_length(closed):
    line = fitted(CIRCLE if closed else BEND, closed=closed)
    for knot in line.knots[1:-1]:
        for order in (1, 2):
            before, after = at(line, knot - 1e-9, order), at(line, knot, order)
            np.testing.assert_allclose(before, after, atol=1e-6)
    lengths = []
    knots = line.knots if closed else line.knots[1:-1]
    for begin, end in pairwise(knots):
        points = np.array([at(line, s) for s in np.linspace(begin, end, 2001)[:-1]])
        lengths.append(np.hypot(*np.diff([*points, at(line, end - 1e-12)], axis=0).T).sum())
    np.testing.assert_allclose(lengths, np.diff(knots), rtol=1e-5)


def test_a_circle_is_met_and_measured():
    line = fitted(CIRCLE, closed=True)
    assert line.length == pytest.approx(math.tau * 5.0, rel=1e-4)
    samples = sample(line, closed=True)
    np.testing.assert_allclose(samples.curvature, 0.2, rtol=1e-2)
    np.testing.assert_allclose(np.hypot(samples.x, samples.y), 5.0, rtol=1e-4)


def test_an_open_line_goes_on_straight():
    line = fitted(BEND, [1.0, 2.0, 1.0, 3.0, 0.5], closed=False)
    for end, step in ((0.0, -1.0), (line.length, 1.0)):
        np.testing.assert_allclose(at(line, end, 2), 0.0, atol=1e-6)
        ahead = at(line, end) + 7.0 * step * at(line, end, 1)
        np.testing.assert_allclose(at(line, end + 7.0 * step), ahead, atol=1e-9)
    np.testing.assert_allclose(line.pieces[[0, -1], 9:12], 0.0, atol=1e-12)
    assert (line.pieces[0, 8], line.pieces[-1, 8]) == pytest.approx((1.0, 0.5))


@given(widths=st.lists(st.floats(0.1, 3.0), min_size=5, max_size=5), closed=st.booleans())
def test_widths_stay_between_those_of_the_neighbours(widths, closed):
    line = fit(BEND, np.array(widths), np.array(widths), closed=closed)
    samples = sample(line, closed=closed)
    ends = np.array([*widths, widths[0]] if closed else widths)
    low = np.minimum(ends[:-1], ends[1:])[samples.point]
    high = np.maximum(ends[:-1], ends[1:])[samples.point]
    assert np.all(samples.widths[0, 0] >= low - 1e-9)
    assert np.all(samples.widths[0, 0] <= high + 1e-9)
