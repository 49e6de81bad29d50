"""The search of a grid finds the shortest lengths, as scipy's does, and lines along them."""

import math

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cmpsp_ros.world import MapSearch
from cmpsp_ros.world.grids import GridObstacle, OccupancyGrid, cells_from, grid_search, lengths_to
from cmpsp_ros.world.obstacles import Obstacle


def reference(costs, goal):
    """By scipy, on the graph of cells beside each other, edges from the goal outwards."""
    number = np.arange(costs.size, dtype=np.int32).reshape(costs.shape)
    begins, ends, weights = [], [], []
    for i, j in np.ndindex(costs.shape):
        for a, b in np.ndindex(3, 3):
            m, n = i + a - 1, j + b - 1
            if (a, b) == (1, 1) or not (0 <= m < costs.shape[0] and 0 <= n < costs.shape[1]):
                continue
            if math.isfinite(costs[m, n]):
                begins.append(number[i, j])
                ends.append(number[m, n])
                weights.append(math.hypot(a - 1, b - 1) * costs[m, n])
    graph = coo_array((weights, (begins, ends)), shape=(costs.size,) * 2).tocsr()
    return dijkstra(graph, indices=number[goal]).reshape(costs.shape)


@pytest.mark.parametrize('seed', range(5))
def test_lengths_are_the_shortest(seed):
    random = np.random.default_rng(seed)
    costs = random.uniform(1.0, 50.0 if seed else 3.0, (23, 31))
    costs[random.random(costs.shape) < 0.35] = math.inf
    costs[4, 7] = 1.0

    found = lengths_to(costs, np.array([4, 7]))

    np.testing.assert_allclose(found, reference(costs, (4, 7)), rtol=1e-12)
    assert np.isinf(found).any()


def test_cells_lead_down_to_the_goal_and_nowhere_from_where_no_way_leads():
    costs = np.ones((9, 9))
    costs[4, :8] = costs[0, :2] = costs[1, :2] = costs[1, 0] = math.inf
    lengths = lengths_to(costs, np.array([8, 0]))

    cells = cells_from(lengths, np.array([2, 0]))

    assert cells[0].tolist() == [2, 0]
    assert cells[-1].tolist() == [8, 0]
    assert (np.abs(np.diff(cells, axis=0)).max(axis=1) == 1).all()
    assert [4, 8] in cells.tolist()
    assert not len(cells_from(lengths, np.array([0, 0])))


CELL = 0.1


def room(*boxes):
    cells = np.zeros((40, 60), np.uint8)
    for top, bottom, left, right in boxes:
        cells[top:bottom, left:right] = 1
    return GridObstacle('map', OccupancyGrid((-3.0, -2.0, 0.0), CELL, cells))


def test_a_line_leads_around_a_wall_and_keeps_clear_of_it():
    wall = room((0, 30, 30, 31))
    search = MapSearch((wall,), 0.2, 0.15, 0.1)
    line = search.line(np.array([-2.0, -1.0]), (2.0, -1.0), 0.2)

    assert line[0].tolist() == [-2.0, -1.0]
    assert line[-1].tolist() == [2.0, -1.0]
    crossing = line[np.abs(line[:, 0]) < 0.2]
    assert (crossing[:, 1] > 1.0 + 0.2).all()
    steps = np.hypot(*np.diff(line, axis=0).T)
    assert steps.max() <= 0.2 + 1e-9
    # It has eight directions, and keeps farther away than it must.
    shortest = 2.0 * math.hypot(2.0, 2.2)
    assert steps.sum() < 1.2 * shortest
    (length,) = search.lengths(line[:1], (2.0, -1.0))
    assert shortest < length < 3.0 * shortest


def test_a_gap_that_is_too_narrow_is_no_way():
    parts = (0, 18, 30, 31), (22, 40, 30, 31)

    def through(distance):
        search = MapSearch((room(*parts),), distance, distance, distance)
        return search.line(np.array([-2.0, 0.0]), (2.0, 0.0), 0.2)

    assert len(through(0.15))
    assert not len(through(0.5))


def test_other_obstacles_are_kept_clear_of_too():
    disc = Obstacle('disc', (0.0, 0.0), 0.5)

    search = MapSearch((disc, room()), 0.2, 0.15, 0.1)
    line = search.line(np.array([-2.0, 0.0]), (2.0, 0.0), 0.2)

    assert np.hypot(*line.T).min() > 0.65


def test_who_stands_too_near_is_led_away():
    wall = room((0, 30, 30, 31))

    line = MapSearch((wall,), 0.4, 0.35, 0.3).line(np.array([-0.3, -1.0]), (-2.0, -1.0), 0.2)

    assert len(line)


def test_the_way_out_of_marked_cells_is_at_most_so_many_cells_long():
    lengths = np.full((3, 9), math.inf)
    lengths[1, 1], lengths[1, 8] = 4.0, 0.0
    marked = np.zeros((3, 9), dtype=bool)
    marked[1, 2:8] = True

    found = grid_search.led_out(lengths, marked, 50.0, 2)

    np.testing.assert_array_equal(
        found[1, 1:9], [4.0, 54.0, 104.0, math.inf, math.inf, 100.0, 50.0, 0.0]
    )
    assert np.isinf(found[[0, 2]]).all()
