"""Distances to the occupied cells of a grid, at nodes and between them."""

import math

import numpy as np
import pytest

from cmpsp_ros.robots.motion import arc_from, arc_part
from cmpsp_ros.world.grids import (
    Cell,
    GridError,
    GridObstacle,
    OccupancyGrid,
    distance_field,
    field_functions,
)
from cmpsp_ros.world.grids.distance_transform import signed_distances

CELL = 0.05


def grid(seed: int, density: float = 0.03, size: int = 30) -> OccupancyGrid:
    random = np.random.default_rng(seed)
    cells = (random.random((size, size + 7)) < density).astype(np.uint8)
    cells[3:9, 5] = cells[3, 5:14] = Cell.OCCUPIED
    origin = (random.uniform(-3, 3), random.uniform(-3, 3), random.uniform(-4, 4))
    return OccupancyGrid(origin, CELL, cells)


def true_distance(grid: OccupancyGrid, points: np.ndarray, *, walled: bool) -> np.ndarray:
    """From all occupied squares, and from the outside of the grid where that is occupied."""
    cosine, sine = math.cos(grid.origin[2]), math.sin(grid.origin[2])
    away = points - np.array(grid.origin[:2])
    u, v = away @ [cosine, sine], away @ [-sine, cosine]
    rows, columns = np.nonzero(grid.cells == Cell.OCCUPIED)
    across = np.maximum(np.abs(u[:, None] - (columns + 0.5) * CELL) - CELL / 2.0, 0.0)
    along = np.maximum(np.abs(v[:, None] - (rows + 0.5) * CELL) - CELL / 2.0, 0.0)
    found = np.hypot(across, along).min(axis=1, initial=1e4)
    if walled:
        wide, high = grid.size
        walls = np.minimum.reduce([u, v, wide - u, high - v])
        found = np.minimum(found, np.maximum(walls, 0.0))
    return found


def points_in(grid: OccupancyGrid, count: int, seed: int, beyond: float = 0.0) -> np.ndarray:
    random, (wide, high) = np.random.default_rng(seed), grid.size
    u = random.uniform(-beyond, wide + beyond, count)
    v = random.uniform(-beyond, high + beyond, count)
    cosine, sine = math.cos(grid.origin[2]), math.sin(grid.origin[2])
    return np.array(grid.origin[:2]) + np.column_stack(
        [cosine * u - sine * v, sine * u + cosine * v]
    )


@pytest.mark.parametrize('unknown_is_free', [False, True])
@pytest.mark.parametrize('seed', range(4))
def test_nodes_have_the_exact_distance(seed: int, unknown_is_free: bool) -> None:
    world = grid(seed)
    field = distance_field(world, unknown_is_free=unknown_is_free)
    centers = world.centers(*np.indices(world.cells.shape)).reshape(-1, 2)

    wanted = true_distance(world, centers, walled=not unknown_is_free)

    found = field.distances[2:-2, 2:-2].ravel()
    free = world.cells.ravel() == Cell.FREE
    np.testing.assert_allclose(found[free], wanted[free], atol=1e-12)
    assert (found[~free] <= -CELL / 2.0 + 1e-12).all()


@pytest.mark.parametrize('unknown_is_free', [False, True])
@pytest.mark.parametrize('seed', range(4))
def test_neither_function_says_more_than_the_distance(seed: int, unknown_is_free: bool) -> None:
    world = grid(seed)
    field = distance_field(world, unknown_is_free=unknown_is_free)
    points = points_in(world, 4000, seed, beyond=0.3)
    wanted = true_distance(world, points, walled=not unknown_is_free)

    smooth = np.array([field_functions.away_from(field, *point)[0] for point in points.tolist()])
    bound = np.array([field_functions.distance_from(field, *point) for point in points.tolist()])

    assert (smooth <= wanted + 1e-12).all()
    assert (bound <= wanted + 1e-12).all()
    # The check of a plan does not refuse what the plan keeps to.
    far = wanted > 2.0 * CELL
    assert (bound > smooth)[far].all()
    within = world.contains(*world.indices(points))
    assert np.median((wanted - bound)[far & within]) < 0.05 * CELL
    assert (wanted - bound)[far & within].max() < CELL


@pytest.mark.parametrize('unknown_is_free', [False, True])
def test_value_and_gradient_are_continuous(unknown_is_free: bool) -> None:
    world, step = grid(1), 1e-6
    field = distance_field(world, unknown_is_free=unknown_is_free)
    points = points_in(world, 300, 5)

    for x, y in points.tolist():
        value, slope_x, slope_y = field_functions.away_from(field, x, y)
        for dx, dy in ((step, 0.0), (0.0, step)):
            ahead = field_functions.away_from(field, x + dx, y + dy)
            behind = field_functions.away_from(field, x - dx, y - dy)
            slope = (ahead[0] - behind[0]) / (2.0 * step)
            assert slope == pytest.approx(slope_x if dx else slope_y, abs=1e-3)
            assert ahead[1:] == pytest.approx((slope_x, slope_y), abs=1e-3)
        assert value < math.inf


def test_along_an_arc_the_bound_holds_and_is_close() -> None:
    world = grid(2)
    field = distance_field(world)
    random = np.random.default_rng(7)

    for x, y in points_in(world, 200, 3).tolist():
        heading, length = random.uniform(-3, 3), random.uniform(-0.4, 0.4)
        arc = arc_from(x, y, heading, length, random.uniform(-2, 2))
        places = [arc_part(arc, part)[:2] for part in np.linspace(0.0, 1.0, 400)]
        wanted = true_distance(world, np.array(places), walled=True).min()
        exact = field_functions.sweep(field, arc, math.inf)
        pointwise = min(field_functions.distance_from(field, *place) for place in places)

        assert exact <= wanted + 1e-6
        if wanted > 3.0 * CELL:
            assert exact >= pointwise - 1e-3
            assert field_functions.sweep(field, arc, 0.0) <= exact + 1e-6


def test_beyond_the_grid_nothing_is_free_unless_it_is_said_to_be() -> None:
    world = OccupancyGrid((0.0, 0.0, 0.0), CELL, np.zeros((20, 20), np.uint8))
    closed, free = distance_field(world), distance_field(world, unknown_is_free=True)

    depths = [field_functions.distance_from(closed, -0.2 * each, 0.5) for each in range(4)]

    assert sorted(depths, reverse=True) == depths
    assert depths[-1] < -0.5
    assert field_functions.distance_from(free, -5.0, 0.5) > 100.0


@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_what_is_no_place_has_no_distance(bad: float) -> None:
    field = distance_field(grid(1))

    assert math.isnan(field_functions.away_from(field, bad, 0.0)[0])
    assert math.isnan(field_functions.distance_from(field, 0.0, bad))
    assert math.isnan(field_functions.sweep(field, arc_from(0.0, bad, 0.0, 0.1, 0.1), 0.0))


def test_a_grid_without_a_free_cell_has_finite_distances() -> None:
    world = OccupancyGrid((0.0, 0.0, 0.0), CELL, np.full((5, 5), Cell.UNKNOWN, np.uint8))

    assert np.isfinite(distance_field(world).distances).all()
    GridObstacle('map', world, unknown_is_free=True).check_space()
    with pytest.raises(GridError, match='free'):
        GridObstacle('map', world).check_space()


def from_each_square(marked: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(marked)
    found = np.empty(marked.shape)
    for i, j in np.ndindex(marked.shape):
        up = np.maximum(np.abs(rows - i) - 0.5, 0.0)
        across = np.maximum(np.abs(columns - j) - 0.5, 0.0)
        found[i, j] = np.sqrt((2.0 * up) ** 2 + (2.0 * across) ** 2).min() / 2.0
    return found


@pytest.mark.parametrize('share', [0.01, 0.1, 0.5, 0.95])
@pytest.mark.parametrize('seed', range(10))
def test_distances_are_exact_to_the_last_bit(seed: int, share: float) -> None:
    random = np.random.default_rng(seed)
    marked = random.random(random.integers(2, 40, 2)) < share
    marked[0, random.integers(marked.shape[1])] = True
    marked[-1, random.integers(marked.shape[1])] = False

    expected = from_each_square(marked)
    expected[marked] = -from_each_square(~marked)[marked]

    assert np.array_equal(signed_distances(marked), expected)


def test_without_a_mark_distances_are_infinite() -> None:
    assert (signed_distances(np.zeros((3, 4), dtype=bool)) == math.inf).all()
    assert (signed_distances(np.ones((3, 4), dtype=bool)) == -math.inf).all()


def test_a_single_row_and_a_single_column() -> None:
    assert signed_distances(np.array([[False, False, True]])).tolist() == [[1.5, 0.5, -0.5]]
    assert signed_distances(np.array([[True], [False]])).tolist() == [[-0.5], [0.5]]
