"""The road along a line through points."""

import math
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.robots.motion import arc_from
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.roads import Corridor, RoadError
from cmpsp_ros.world.roads import road_functions as functions
from cmpsp_ros.world.roads.center_line import fit, sample

ANGLES = np.arange(60) * math.tau / 60


def corridor(points, left=0.6, right=None, *, closed=False):
    right = left if right is None else right
    widths = (np.broadcast_to(np.asarray(each, float), len(points)) for each in (left, right))
    return Corridor(
        tuple(map(tuple, np.asarray(points, float).tolist())),
        *(tuple(each.tolist()) for each in widths),
        closed,
    )


EIGHT = np.column_stack([8.0 * np.sin(ANGLES), 4.0 * np.sin(2.0 * ANGLES)])
ROADS = {
    'eight': corridor(EIGHT, closed=True),
    'widening': corridor(EIGHT, 0.8 + 0.2 * np.sin(ANGLES), 0.7, closed=True),
    'open': corridor([(0, 0), (2, 0.3), (4, 2), (4.5, 5), (6, 6.5), (9, 6)], 0.7, 0.5),
}


@cache
def line_of(road):
    return fit(*map(np.asarray, (road.points, road.left, road.right)), closed=road.closed)


@cache
def samples_of(road):
    return sample(line_of(road), closed=road.closed)


def place(road, part, across):
    """A point, its progress, and its distance to the left of the centre line."""
    samples = samples_of(road)
    i = int(part * len(samples.x))
    left, right = samples.widths[:, 0, i]
    off = across * (left if across > 0.0 else right)
    x, y = samples.x[i] - off * samples.sine[i], samples.y[i] + off * samples.cosine[i]
    return x, y, samples.progress[i], off


PARTS = st.floats(0.0, 0.999)
ACROSS = st.floats(-1.0, 1.0)


@pytest.mark.parametrize('name', ROADS)
@given(part=PARTS, across=ACROSS, hint=st.floats(-0.4, 0.4))
def test_projection_finds_the_place_from_nearby(name, part, across, hint):
    road = ROADS[name]
    x, y, progress, off = place(road, part, across)
    found, found_off, first, second = functions.lateral_error(
        road.space(0.0), 0, x, y, progress + hint
    )
    away = found - progress
    away = math.remainder(away, road.length) if road.closed else away
    assert away == pytest.approx(0.0, abs=1e-9)
    assert found_off == pytest.approx(off, abs=1e-9)
    assert max(first, second) <= 1e-9
    if abs(across) == 1.0:
        assert max(first, second) == pytest.approx(0.0, abs=1e-9)


@given(part=PARTS, across=ACROSS)
def test_the_nearest_place_of_a_road_is_that_of_a_search_through_all(part, across):
    road = ROADS['open']
    x, y, _, off = place(road, part, across)
    line = line_of(road)
    at = np.linspace(0.0, line.length, 40_001)
    i = np.minimum(np.searchsorted(line.knots, at, 'right') - 1, len(line.pieces) - 1)
    t = (at - line.knots[i])[:, None] ** np.arange(4)
    away = np.hypot((line.pieces[i, :4] * t).sum(1) - x, (line.pieces[i, 4:8] * t).sum(1) - y)
    space = road.space(0.0)
    found = functions.project(space, x, y, math.nan, math.nan)
    assert found == pytest.approx(at[np.argmin(away)], abs=1e-3)
    assert abs(functions.lateral_error(space, 0, x, y, found)[1]) == pytest.approx(
        away.min(), abs=3e-4
    )
    assert abs(off) == pytest.approx(away.min(), abs=3e-4)


@pytest.mark.parametrize('name', ROADS)
@given(part=PARTS, across=ACROSS)
def test_slopes_are_those_of_finite_differences(name, part, across):
    road, h = ROADS[name], 1e-6
    space = road.space(0.1)
    x, y, progress, _ = place(road, part, across)

    def difference(function):
        by_x = function(x + h, y) - function(x - h, y)
        by_y = function(x, y + h) - function(x, y - h)
        return np.array([by_x, by_y]).T.ravel() / (2.0 * h)

    def measured(x, y):
        return np.array(functions.lateral_error(space, 0, x, y, progress)[1:])

    def gradient(x, y):
        there, off, *_ = functions.lateral_error(space, 0, x, y, progress)
        return off * np.array(functions.gradients(space, x, y, there)[:2])

    found = functions.gradients(space, x, y, progress)
    slopes = np.array([*found[:2], *found[3:]])
    np.testing.assert_allclose(slopes, difference(measured), atol=1e-6)
    across_it = np.array(found[:2])
    along_it = np.array([-across_it[1], across_it[0]])
    second = np.outer(across_it, across_it) + found[2] * np.outer(along_it, along_it)
    np.testing.assert_allclose(second.ravel(), difference(gradient), atol=1e-5)


def test_each_branch_of_a_crossing_is_kept_to():
    space = ROADS['eight'].space(0.0)
    first = functions.project(space, 0.0, 0.0, math.atan2(8.0, 8.0), math.nan)
    second = functions.project(space, 0.0, 0.0, math.atan2(8.0, -8.0), math.nan)
    half = ROADS['eight'].length / 2.0
    assert min(first, 2.0 * half - first) == pytest.approx(0.0, abs=1e-6)
    assert second == pytest.approx(half, abs=1e-6)
    # Across the crossing, step by step: the other branch is nearer in between, and not taken.
    progress = functions.project(space, -0.8, -0.7, 0.75, math.nan)
    for step in np.linspace(0.0, 1.0, 9):
        x, y = -0.8 + 1.6 * step, -0.7 + 1.4 * step
        before, (progress, off, *_) = progress, functions.lateral_error(space, 0, x, y, progress)
        assert abs(math.remainder(progress - before, 2.0 * half)) < 0.4
        assert abs(off) < 0.2


def test_a_closed_road_goes_on_where_it_began():
    road = ROADS['eight']
    space = road.space(0.0)
    x, y, *_ = place(road, 0.002, 0.3)
    found, off, *_ = functions.lateral_error(space, 0, x, y, road.length - 0.1)
    assert 0.0 <= found < 0.2
    assert off == pytest.approx(0.3 * 0.6)
    way = functions.arc_length_to(space, 0.0, 0.0, road.length - 1.0, 0.0, 0.0, 0.5)
    assert way == pytest.approx(1.5)
    way = functions.arc_length_to(space, 0.0, 0.0, 0.5, 0.0, 0.0, road.length - 1.0)
    assert way == pytest.approx(-1.5)
    np.testing.assert_allclose(
        functions.point_ahead(space, 0.0, 0.0, road.length - 1.0, 1.0, (0.0, 0.0)),
        EIGHT[0],
        atol=1e-9,
    )


@pytest.mark.parametrize('name', ROADS)
@settings(max_examples=60)
@given(
    part=PARTS,
    across=st.floats(-0.95, 0.95),
    aside=st.floats(-math.pi, math.pi),
    length=st.floats(-0.6, 0.6),
    turn=st.floats(-3.0, 3.0),
    enough=st.sampled_from([math.inf, 0.3, -0.2]),
)
def test_sweeps_find_what_many_samples_find(name, part, across, aside, length, turn, enough):
    road = ROADS[name]
    space = road.space(0.05)
    x, y, progress, _ = place(road, part, across)
    arc = arc_from(x, y, aside, length, turn)
    end, *swept = functions.sweep(space, arc, progress, enough, enough)
    at, least = progress, np.full(2, np.inf)
    for t in np.linspace(0.0, 1.0, 257):
        there = arc_from(x, y, aside, length * t, turn * t)
        at, _, *over = functions.lateral_error(space, 0, there.end_x, there.end_y, at)
        least = np.minimum(least, -np.array(over))
    assert math.remainder(end - at, road.length) == pytest.approx(0.0, abs=1e-8)
    for found, wanted in zip(swept, least, strict=True):
        # A smaller one is missed only by so much, and only where it is not small enough to matter.
        close = min(wanted, enough)
        assert found >= wanted - 1e-4
        assert min(found, enough) <= close + 2e-6 + 0.0102 * max(close, 0.0)


@pytest.mark.parametrize('known', [True, False])
@pytest.mark.parametrize('name', ROADS)
def test_paths_clear_at_samples_are_clear_between_them(name, known):
    road, rng = ROADS[name], np.random.default_rng(0)
    robot = DifferentialDrive(max_wheel_speed=51.0)
    space = FreeSpace.of(road, (), 0.0)
    samples, clear, cut = samples_of(road), 0, 0
    for _ in range(1500):
        part, across = rng.random(), rng.choice([-1.0, 1.0]) * rng.uniform(0.6, 1.0)
        x, y, _, _ = place(road, part, across)
        i = int(part * len(samples.x))
        heading = math.atan2(samples.sine[i], samples.cosine[i]) + rng.normal(scale=0.4)
        wheels, times = rng.uniform(0.0, 51.0, size=(2, 2)), np.full(2, 0.2)
        if np.hypot(x, y) < 3.0 and road.closed:
            # Single poses near a crossing may be meant to be on either branch.
            continue
        poses = robot.roll_out(np.array([x, y, heading]), wheels, times)
        twists = robot.twist(wheels)
        limits = robot.twist_limits()
        grown = space.for_samples_of(twists, 0.2) if known else space.tightened(limits, 0.2)
        swept = space.along(poses[:-1], twists, times).min()
        if grown.at(poses).min() >= 0.0:
            assert swept >= -2e-6
            clear += 1
        elif space.at(poses).min() >= 0.0 and swept < -1e-4:
            cut += 1
    assert clear > 100
    assert cut, 'keeping clear at the samples alone must be seen not to be enough'


def test_pictures_show_the_whole_road():
    road = ROADS['open']
    left, right = road.edges()
    np.testing.assert_allclose(road.center_line()[[0, -1]], [road.points[0], road.points[-1]])
    np.testing.assert_allclose(np.hypot(*(left - right).T), 1.2)
    closed = ROADS['eight']
    np.testing.assert_array_equal(closed.center_line()[0], closed.center_line()[-1])
    assert len(closed.area()) == sum(map(len, closed.edges()))
    assert road.beyond((-0.5, 0.0)) == pytest.approx(0.5, abs=0.02)
    assert road.beyond((2.0, 0.0)) == 0.0
    assert road.beyond((8.99, 6.0)) == 0.0
    assert closed.beyond((0.0, 0.0)) == 0.0


@pytest.mark.parametrize(
    ('points', 'width', 'closed', 'point', 'said'),
    [
        ([(0, 0)], 0.5, False, 1, '2 points or more'),
        ([(0, 0), (1, 0)], 0.5, True, 2, '3 points or more'),
        ([(0, 0), (1, 0), (1, 0), (2, 0)], 0.5, False, 2, 'same place'),
        ([(0, 0), (4, 0), (2, 3), (0, 0)], 0.1, True, 3, 'same place'),
        ([(0, 0), (1, 0), (2, 0), (1.5, 0.1), (3, 0)], 0.2, False, 2, 'turn back'),
        ([(0, 0), (1, 0), (2, 0)], [0.5, 0.0, 0.5], False, 1, 'width of 0 m'),
        ([(0, 0), (1, 0), (2, 0)], [0.5, 0.5, -1.0], False, 2, 'width of -1 m'),
        ([(0, 0), (2, 0), (3, 0), (3, 1), (3, 3)], 1.5, False, 2, 'curve of radius'),
    ],
)
def test_what_is_no_road_is_refused_with_the_point(points, width, closed, point, said):
    with pytest.raises(RoadError, match=said) as caught:
        corridor(points, width, closed=closed)
    assert caught.value.point == point


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
