"""Road coordinates on every kind of road, and the gaps that walls and edges leave in them."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import ROAD, settings, start_of

from cmpsp_ros.guidance.planning.homotopy.gaps import free_gaps
from cmpsp_ros.guidance.planning.homotopy.path_search import class_of
from cmpsp_ros.guidance.planning.homotopy.road_frame import locate, point_at, road_frame
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import Capsule
from cmpsp_ros.world.obstacles.shapes import Polygon
from cmpsp_ros.world.roads import Corridor, OpenFloor

START, GOAL = (0.0, -9.6, 0.0), (10.2, 0.0)
WALL = Capsule('wall', (6.9, -6.9), (7.2, -7.2), 0.05)
BEND = Corridor(
    ((0.0, -10.0), (5.0, -9.0), (8.5, -5.0), (10.0, 0.0), (10.0, 3.0)), (0.8,) * 5, (1.2,) * 5
)


def frame_on(road, obstacles=(), start=START, goal=GOAL):
    given = settings(obstacles, 51.0, ROAD, road=road, goal=goal)
    return given, road_frame(given, start_of(given, start), given.target)


COURSES = {
    'polar': (settings().road, ()),
    'a line between circles': (settings().road, (WALL,)),
    'corridor': (BEND, ()),
    'floor': (OpenFloor(), ()),
}


@pytest.mark.parametrize('course', COURSES)
@pytest.mark.parametrize('off', [-0.5, 0.0, 0.4])
def test_a_point_is_where_its_coordinates_say(course, off):
    _, frame = frame_on(*COURSES[course])
    bearing, before = frame.begin, 0.0
    for at in np.linspace(0.0, frame.stations[-1], 40).tolist():
        x, y = point_at(frame, at, frame.middle + off)
        found, lateral, bearing = locate(frame, x, y, before, bearing)
        assert found == pytest.approx(at, abs=5e-3 + 0.05 * abs(off))
        assert lateral == pytest.approx(frame.middle + off, abs=3e-3)
        before = found


def gaps_of(road, obstacles, **places):
    _, frame = frame_on(road, obstacles, **places)
    return frame, *free_gaps(frame, FreeSpace.of(road, obstacles, 0.1))


def test_the_edges_of_a_corridor_are_as_far_as_it_is_wide():
    _, gaps, edges = gaps_of(BEND, ())
    assert gaps == [[each] for each in edges]
    # Clearance counts a little less where the width changes, and never more.
    for low, high in edges:
        assert -1.1 <= low <= -1.05
        assert 0.65 <= high <= 0.7


def test_a_wall_from_an_edge_leaves_one_gap_and_one_in_the_middle_two():
    line = Corridor(((0.0, 0.0), (9.0, 0.0)), (1.0, 1.0), (1.0, 1.0))
    places = {'start': (0.5, 0.0, 0.0), 'goal': (8.5, 0.0)}
    edge = Capsule('wall', (5.0, 1.2), (5.0, -0.2), 0.05)
    frame, gaps, _ = gaps_of(line, (edge,), **places)
    beside = min(gaps, key=lambda each: sum(high - low for low, high in each))
    assert beside == [(pytest.approx(-0.9), pytest.approx(-0.35, abs=1e-3))]
    middle = replace(edge, start=(5.0, 0.4))
    frame, gaps, _ = gaps_of(line, (middle,), **places)
    assert [len(each) for each in gaps].count(2) in (2, 3)
    assert len(gaps) == len(frame.stations)


def test_cells_of_a_map_leave_the_gaps_that_a_wall_of_their_outline_leaves():
    line = Corridor(((0.0, 0.0), (9.0, 0.0)), (1.0, 1.0), (1.0, 1.0))
    places = {'start': (0.5, 0.0, 0.0), 'goal': (8.5, 0.0)}
    cells = np.zeros((60, 200), np.uint8)
    cells[26:41, 89:103] = Cell.OCCUPIED
    grid = GridObstacle('map', OccupancyGrid((0.0, -1.5, 0.0), 0.05, cells), unknown_is_free=True)
    corners = ((4.45, -0.2), (5.15, -0.2), (5.15, 0.55), (4.45, 0.55))
    _, found, _ = gaps_of(line, (grid,), **places)
    _, wanted, _ = gaps_of(line, (Polygon('wall', corners),), **places)
    assert {len(each) for each in wanted} == {1, 2}
    assert [len(each) for each in found] == [len(each) for each in wanted]
    for one, other in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, other, atol=0.06)


@pytest.mark.parametrize('course', COURSES)
def test_sides_are_seen_from_the_path(course):
    _, frame = frame_on(*COURSES[course])
    middle = frame.stations[len(frame.stations) // 2]
    center = point_at(frame, float(middle), frame.middle)
    obstacles = frame.coordinates(np.array([center, (-0.5, -9.7)]))
    for side in (1, -1):
        lateral = frame.middle + 0.4 * side * frame.left
        path = [[*point_at(frame, float(at), lateral), 0.0] for at in frame.stations]
        assert class_of(frame, obstacles, np.array(path)) == (side, 0)
