"""Every kind of road that parameters name, against its own edges in dense plain numpy."""

import math
import pickle

import geometry as dense
import numpy as np
import pytest

from cmpsp_ros.parameters import TABLE
from cmpsp_ros.parameters.roads import ROAD_TYPES, road_of
from cmpsp_ros.world.roads import kinds
from cmpsp_ros.world.roads.road_functions import (
    arc_length_to,
    gradients,
    lateral_error,
    point_ahead,
    project,
)

# What a type needs beside the defaults of its parameters.
NEEDED = {'corridor': {'road.points': [0.0, 0.0, 6.0, 0.5, 12.0, -1.0, 18.0, 0.0]}}
ROADS = {
    kind: road_of(TABLE.resolve({'road.type': kind, **NEEDED.get(kind, {})}))
    for kind in ROAD_TYPES
    if kind != 'none'
}
EDGE = 1e-2


@pytest.fixture(params=ROADS)
def road(request):
    return ROADS[request.param]


def points_on(road, count=60):
    """Poses about the middle of a road and beyond its edges, not near its ends, with progress."""
    random, line = np.random.default_rng(3), road.center_line()
    inner = line[len(line) // 5 : -len(line) // 5]
    for at in random.integers(0, len(inner) - 1, count):
        along = inner[at + 1] - inner[at]
        heading = math.atan2(along[1], along[0])
        x, y = inner[at] + 0.8 * road.width * random.uniform(-1.0, 1.0) * np.array(
            [-math.sin(heading), math.cos(heading)]
        )
        yield x, y, heading, project(road.space(0.0), x, y, heading, math.nan)


def clearance(road, x, y, progress):
    return -max(lateral_error(road.space(0.0), 0, x, y, progress)[2:])


def from_edges(road, points):
    """Distance from the nearest edge, negative outside of the road's area."""
    least = np.min([dense.from_line(points, edge, closed=False) for edge in road.edges()], axis=0)
    area, after = road.area(), np.roll(road.area(), -1, axis=0)
    x, y = points[..., None, 0], points[..., None, 1]
    crosses = (area[:, 1] > y) != (after[:, 1] > y)
    rise = np.where(after[:, 1] == area[:, 1], 1.0, after[:, 1] - area[:, 1])
    left = x < area[:, 0] + (y - area[:, 1]) * (after[:, 0] - area[:, 0]) / rise
    return np.where((crosses & left).sum(axis=-1) % 2, least, -least)


def test_every_kind_has_a_type():
    made = [*ROADS.values(), road_of(TABLE.resolve({'road.type': 'none'}))]
    assert {type(each) for each in made} == set(kinds())


def test_clearance_is_the_distance_from_the_nearest_edge(road):
    signs = set()
    for x, y, _, progress in points_on(road):
        found, known = clearance(road, x, y, progress), from_edges(road, np.array([x, y]))
        signs.add(known > 0.0)
        assert found <= known + EDGE
        assert found >= known * (road.clearance_scale.min() if known > 0.0 else 1.1) - EDGE
    assert signs == {True, False}


def test_gradients_are_differences(road):
    space, step = road.space(0.1), 1e-6
    for x, y, _, progress in points_on(road):
        at = lateral_error(space, 0, x, y, progress)[0]
        found = np.array(gradients(space, x, y, at))
        difference = np.array(
            [
                np.subtract(
                    lateral_error(space, 0, x + dx, y + dy, progress),
                    lateral_error(space, 0, x - dx, y - dy, progress),
                )
                / (2.0 * step)
                for dx, dy in ((step, 0.0), (0.0, step))
            ]
        )
        for place, column in ((0, 1), (3, 2), (5, 3)):
            np.testing.assert_allclose(found[place : place + 2], difference[:, column], atol=1e-5)


def test_a_point_ahead_is_that_far_along_the_centre_line(road):
    space, line = road.space(0.0), road.center_line()
    for x, y, heading, progress in points_on(road, 20):
        ahead_x, ahead_y = point_ahead(space, x, y, progress, 1.0, (0.0, 0.0))
        assert dense.from_line(np.array([ahead_x, ahead_y]), line, closed=False) < EDGE
        there = project(space, ahead_x, ahead_y, heading, math.nan)
        way = arc_length_to(space, x, y, progress, ahead_x, ahead_y, there)
        assert way == pytest.approx(1.0, abs=1e-6)


def test_a_road_is_a_value(road):
    road.space(0.2)
    assert pickle.loads(pickle.dumps(road)) == road
    pose = road.middle()
    assert clearance(road, *pose[:2], project(road.space(0.0), *pose, math.nan)) > 0.0
    assert from_edges(road, road.beside()[None, :2])[0] < 0.0
