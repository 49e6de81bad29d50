"""Capsules, convex polygons and moving discs, against dense sampling without a formula of ours."""

import math

import numpy as np
import pytest
from dense_drives import error_of, integrated
from geometry import from_line, from_polygon
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.robots.motion import arc_ends, arc_from
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, MovingDiscs, Obstacle, ShapeError, away_from, convex
from cmpsp_ros.world.obstacles.shapes import Polygon
from cmpsp_ros.world.roads import OpenFloor

FLOOR = OpenFloor()
EDGES = 2
places = st.floats(-3.0, 3.0)
points = st.tuples(places, places)
shares = st.floats(-1.0, 1.0)


@st.composite
def polygons(draw):
    """Convex, since its corners lie on an ellipse; not so thin that nothing is left of it."""
    count = draw(st.integers(3, 7))
    steps = draw(st.lists(st.floats(0.4, 1.0), min_size=count, max_size=count))
    angles = draw(st.floats(0.0, 6.0)) + math.tau * np.cumsum(steps) / sum(steps)
    x, y = draw(points)
    wide, high = draw(st.floats(0.1, 2.0)), draw(st.floats(0.1, 2.0))
    corners = [(x + wide * math.cos(a), y + high * math.sin(a)) for a in angles]
    return convex('room', corners if draw(st.booleans()) else corners[::-1])


capsules = st.builds(Capsule, st.just('wall'), points, points, st.floats(0.05, 1.0))
shapes = st.one_of(capsules, polygons())


def signed(shape, point):
    """Distance of points ``(K, 2)`` from a shape without its radius, negative inside."""
    if len(shape.corners) > 2:
        return from_polygon(point, shape.corners)
    return from_line(point, shape.corners, closed=True)


def clear_of(shape, distance=0.0):
    return FreeSpace.of(FLOOR, (shape,), distance)


@hypothesis_settings(max_examples=150)
@given(shape=shapes, point=points)
def test_distance_and_gradient(shape, point):
    space = clear_of(shape)
    found, x, y = away_from(space.data.shapes, 0, 0, *point)
    wanted = signed(shape, np.array([point]))[0]
    assert found == pytest.approx(wanted, abs=1e-12)
    assert math.hypot(x, y) == pytest.approx(1.0)
    clearance = space.at(np.array([[*point, 0.0]]))[0, EDGES]
    assert clearance == pytest.approx(wanted - shape.radius, abs=1e-12)
    # Where the distance has a gradient at all, and not right beside a place where it has none.
    assume(abs(wanted) > 1e-2)
    step = 1e-6
    ahead = [signed(shape, np.array(point) + step * np.eye(2)), -np.eye(2) * step + point]
    slope = (ahead[0] - signed(shape, ahead[1])) / (2.0 * step)
    assume(abs(math.hypot(*slope) - 1.0) < 1e-4)
    np.testing.assert_allclose([x, y], slope, atol=1e-3)


def test_gradient_where_there_is_none_leads_out():
    wall = clear_of(Capsule('wall', (0.0, 0.0), (2.0, 0.0), 0.1))
    assert away_from(wall.data.shapes, 0, 0, 1.0, 0.0) == (0.0, 0.0, -1.0)
    point = clear_of(Capsule('point', (1.0, 1.0), (1.0, 1.0), 0.1))
    assert away_from(point.data.shapes, 0, 0, 1.0, 1.0) == (0.0, 1.0, 0.0)


drives = {
    'wheels': st.tuples(shares, shares),
    'period': st.floats(0.02, 1.0),
    'start': points,
    'heading': st.floats(-math.pi, math.pi),
}
ROBOT = DifferentialDrive(max_wheel_speed=51.0)


def driven(wheels, period, start, heading):
    """An arc, and places along it that are integrated."""
    wheels = ROBOT.max_wheel_speed * np.array([wheels])
    pose = np.array([*start, heading])
    (speed, turn_rate) = ROBOT.twist(wheels[0])
    arc = arc_from(*pose.tolist(), float(speed * period), float(turn_rate * period))
    return arc, integrated(pose, wheels, period, ROBOT), error_of(wheels, period, ROBOT)


@hypothesis_settings(max_examples=150)
@given(**drives, shape=shapes, further=st.floats(0.0, 0.2))
def test_samples_clear_of_a_shape_keep_arcs_clear(shape, wheels, period, start, heading, further):
    _, path, error = driven(wheels, period, start, heading)
    space = clear_of(shape, 0.05).tightened(ROBOT.twist_limits(), period)
    ends = signed(shape, path[[0, -1]])
    # The path is moved away until its ends keep what they must, and no further than that.
    lack = float(space.radii[0]) + further - ends.min()
    center = np.mean(shape.corners, axis=0)
    out = path[[0, -1]].mean(axis=0) - center
    assume(np.linalg.norm(out) > 1e-3)
    path = path + max(lack, 0.0) * out / np.linalg.norm(out)
    assume((signed(shape, path[[0, -1]]) >= space.radii[0]).all())
    assert signed(shape, path).min() >= shape.radius + 0.05 - error


@hypothesis_settings(max_examples=150)
@given(
    **drives,
    radius=st.floats(0.05, 1.0),
    bearing=st.floats(-math.pi, math.pi),
    velocity=st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)),
    growth=st.floats(0.0, 0.3),
    known=st.booleans(),
)
def test_samples_clear_of_what_moves_keep_arcs_clear(
    wheels, period, start, heading, radius, bearing, velocity, growth, known
):
    _, path, error = driven(wheels, period, start, heading)
    times = np.array([0.0, period])

    def kept(point):
        states = np.array([[*point, *velocity, radius, growth, 0.0]])
        discs = MovingDiscs(('it',), states, np.zeros(1, np.int64))
        if known:
            twists = ROBOT.twist(ROBOT.max_wheel_speed * np.array([wheels]))
            return discs.for_samples_of(times, twists, period)
        return discs.tightened(times, ROBOT.twist_limits(), period, path[0])

    # As near as both samples allow, on the chord's middle seen from the disc.
    motion = period * np.array(velocity)
    middle = (path[0] + path[-1] - motion) / 2.0
    out = np.array([math.cos(bearing), math.sin(bearing)])
    low, high = 0.0, 20.0
    for _ in range(60):
        away = (low + high) / 2.0
        centers, radii = kept(middle - away * out)
        clear = np.linalg.norm(path[[0, -1]] - centers[:, 0], axis=1) - radii[:, 0]
        low, high = (low, away) if (clear >= 0.0).all() else (away, high)
    point = middle - high * out
    passed = np.linspace(0.0, period, len(path))
    there = point + passed[:, None] * np.array(velocity)
    least = np.linalg.norm(path - there, axis=1) - radius - growth * passed
    assert least.min() >= -error - 1e-9


KNOTS = st.lists(
    st.tuples(st.floats(0.02, 0.3), st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)),
    min_size=1,
    max_size=8,
)


def on_a_way(knots, point=(0.0, 0.0), radius=0.2, growth=0.0):
    """A disc that goes from a point by known steps ``(duration, dx, dy)``."""
    way = np.cumsum([(0.0, *point), *knots], axis=0)
    states = np.array([[*point, 0.0, 0.0, radius, growth, 0.0]])
    return MovingDiscs(('it',), states, np.zeros(1, np.int64), {0: way}), way


def places_on(way, times):
    return np.column_stack([np.interp(times, way[:, 0], way[:, i]) for i in (1, 2)])


@given(KNOTS, st.lists(st.floats(0.01, 0.4), min_size=1, max_size=6), st.floats(0.0, 0.3))
def test_the_straight_legs_of_a_bent_way_cover_it(knots, durations, growth):
    discs, way = on_a_way(knots, growth=growth)
    legs, begin = discs.legs(np.array(durations)), 0.0
    for leg, duration in zip(legs[:, 0], durations, strict=True):
        since = np.linspace(0.0, duration, 50)
        there = leg[:2] + since[:, None] * leg[2:4]
        away = np.linalg.norm(there - places_on(way, begin + since), axis=1)
        assert (away + 0.2 + growth * begin <= leg[4] + 1e-9).all()
        begin += duration


@given(KNOTS, st.lists(st.floats(0.01, 0.4), min_size=1, max_size=6), st.floats(0.0, 0.3))
def test_a_robot_driven_past_a_known_way_is_no_nearer_than_found(knots, durations, growth):
    discs, way = on_a_way(knots, point=(1.0, 0.3), growth=growth)
    held, twist = np.array(durations), np.array([[0.8, 0.5]])
    begins = np.append(0.0, np.cumsum(held))[:-1]
    starts = arc_ends(np.zeros((1, 3)), twist, begins)
    found = discs.along(starts, np.tile(twist, (len(held), 1)), held, begins)[:, 0]
    for begin, duration, least in zip(begins, durations, found, strict=True):
        times = begin + np.linspace(0.0, duration, 50)
        path = arc_ends(np.zeros((1, 3)), twist, times)[:, :2]
        away = np.linalg.norm(path - places_on(way, times), axis=1) - 0.2 - growth * times
        assert least <= away.min() + 1e-9


@given(KNOTS, st.floats(0.1, 1.0))
def test_a_way_looked_at_later_is_the_same_way(knots, seconds):
    discs, _ = on_a_way(knots, growth=0.1)
    times = np.array([0.0, 0.1, 0.7])
    for one, other in zip(
        discs.after(seconds).at_times(times), discs.at_times(seconds + times), strict=True
    ):
        np.testing.assert_allclose(one, other, atol=1e-12)


@hypothesis_settings(max_examples=150)
@given(
    **drives,
    bearing=st.floats(-math.pi, math.pi),
    knots=KNOTS,
    growth=st.floats(0.0, 0.3),
    known=st.booleans(),
)
def test_samples_clear_of_a_known_way_keep_arcs_clear(
    wheels, period, start, heading, bearing, knots, growth, known
):
    _, path, error = driven(wheels, period, start, heading)
    times, out = np.array([0.0, period]), np.array([math.cos(bearing), math.sin(bearing)])
    passed = np.linspace(0.0, period, len(path))

    def least(away):
        """Clearance at the samples beyond what they keep, and between them."""
        discs, way = on_a_way(knots, path[0][:2] - away * out, growth=growth)
        if known:
            twists = ROBOT.twist(ROBOT.max_wheel_speed * np.array([wheels]))
            centers, radii = discs.for_samples_of(times, twists, period)
        else:
            centers, radii = discs.tightened(times, ROBOT.twist_limits(), period, path[0])
        spare = np.linalg.norm(path[[0, -1]] - centers[:, 0], axis=1) - radii[:, 0]
        between = np.linalg.norm(path - places_on(way, passed), axis=1) - 0.2 - growth * passed
        return spare.min(), between.min()

    low, high = 0.0, 20.0
    for _ in range(60):
        away = (low + high) / 2.0
        low, high = (low, away) if least(away)[0] >= 0.0 else (away, high)
    assert least(high)[1] >= -error - 1e-9


def test_discs_out_of_reach_ask_for_nothing():
    states = np.array([[3.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0], [0.8, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0]])
    discs = MovingDiscs(('far', 'near'), states, np.arange(2))
    times = np.array([0.0, 0.2, 0.4, 2.0])
    _, radii = discs.tightened(times, ROBOT.twist_limits(), 0.2, np.zeros(3))
    assert (radii[:3, 0] == -np.inf).all()
    assert radii[3, 0] > 0.5
    assert (radii[1:, 1] > 0.5).all()


SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def test_vertices_come_in_either_sense():
    assert convex('a', SQUARE) == Polygon('a', tuple(SQUARE))
    assert set(convex('a', SQUARE[::-1]).vertices) == set(SQUARE)
    space = clear_of(convex('a', SQUARE[::-1]))
    assert space.at(np.array([[0.5, 0.4, 0.0]]))[0, EDGES] == pytest.approx(-0.4)


@pytest.mark.parametrize(
    ('vertices', 'vertex', 'found'),
    [
        (SQUARE[:2], 1, '2 vertices'),
        ([*SQUARE[:3], (0.9, 0.5)], 3, 'not convex'),
        ([*SQUARE[:2], (1.0, 0.0), *SQUARE[2:]], 2, 'the place of the vertex before'),
        ([*SQUARE[:2], (1.0, 0.5), *SQUARE[2:]], 2, 'not convex'),
        ([SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3]], 0, 'not convex'),
        ([SQUARE[i] for i in (0, 1, 2, 3, 0, 1, 2, 3)], 7, 'a second time round'),
    ],
)
def test_what_is_no_convex_polygon(vertices, vertex, found):
    with pytest.raises(ShapeError, match=found) as caught:
        convex('a', vertices)
    if vertex:
        assert caught.value.vertex == vertex


@pytest.mark.parametrize(
    'shape',
    [
        Obstacle('a', (1.0, 2.0), 0.5),
        Capsule('b', (1.0, 2.0), (3.0, -1.0), 0.4),
        convex('c', SQUARE),
    ],
)
@pytest.mark.parametrize('more', [0.0, 0.3])
def test_outlines_lie_at_their_distance(shape, more):
    (line,) = shape.outlines(shape.radius + more)
    np.testing.assert_allclose(line[0], line[-1], atol=1e-12)
    np.testing.assert_allclose(signed(shape, line), shape.radius + more, atol=1e-9)
