"""A grid knows where its cells are, at any pose, and refuses what is none."""

import math

import numpy as np
import pytest

from cmpsp_ros.world.grids import Cell, GridError, OccupancyGrid

CELLS = np.zeros((3, 4), np.uint8)
POSES = [(0.0, 0.0, 0.0), (-2.5, 7.0, 0.6), (1e3, -1e3, -2.9)]


@pytest.mark.parametrize('origin', POSES)
def test_a_cell_is_where_its_centre_is(origin: tuple[float, float, float]) -> None:
    grid = OccupancyGrid(origin, 0.05, CELLS)
    rows, columns = np.indices(CELLS.shape)

    found = grid.indices(grid.centers(rows, columns))

    assert np.array_equal(found[0], rows)
    assert np.array_equal(found[1], columns)


def test_the_origin_is_the_corner_and_yaw_turns_about_it() -> None:
    grid = OccupancyGrid((1.0, 2.0, math.pi / 2.0), 0.5, CELLS)

    center = grid.centers(np.array(0), np.array(2))

    assert center == pytest.approx([1.0 - 0.25, 2.0 + 1.25])


def test_outside_the_grid_nothing_is_known() -> None:
    cells = CELLS.copy()
    cells[2, 3] = Cell.OCCUPIED
    grid = OccupancyGrid((0.0, 0.0, 0.0), 1.0, cells)

    found = grid.at(np.array([[3.5, 2.5], [0.5, 0.5], [-0.1, 0.5], [4.1, 2.5]]))

    assert found.tolist() == [Cell.OCCUPIED, Cell.FREE, Cell.UNKNOWN, Cell.UNKNOWN]


@pytest.mark.parametrize(
    ('origin', 'resolution', 'cells', 'where'),
    [
        ((math.nan, 0.0, 0.0), 0.1, CELLS, 'origin'),
        ((0.0, 0.0, math.inf), 0.1, CELLS, 'origin'),
        ((0.0, 0.0, 0.0), 0.0, CELLS, 'resolution'),
        ((0.0, 0.0, 0.0), -1.0, CELLS, 'resolution'),
        ((0.0, 0.0, 0.0), math.nan, CELLS, 'resolution'),
        ((0.0, 0.0, 0.0), 0.1, np.zeros((0, 4), np.uint8), 'cells'),
        ((0.0, 0.0, 0.0), 0.1, np.zeros(4, np.uint8), 'cells'),
        ((0.0, 0.0, 0.0), 0.1, np.broadcast_to(np.uint8(0), (40_000, 30_000)), 'cells'),
        ((0.0, 0.0, 0.0), 0.1, CELLS + np.uint8(len(Cell)), 'cells'),
        ((0.0, 0.0, 0.0), 0.1, CELLS.astype(float), 'cells'),
    ],
)
def test_what_is_no_grid_is_refused(
    origin: tuple[float, float, float], resolution: float, cells: np.ndarray, where: str
) -> None:
    with pytest.raises(GridError) as error:
        OccupancyGrid(origin, resolution, cells)

    assert error.value.where == where


def test_the_part_around_points_is_where_it_was() -> None:
    cells = np.random.default_rng(1).integers(0, 3, (30, 40), dtype=np.uint8)
    whole = OccupancyGrid((1.0, -2.0, 0.7), 0.1, cells)
    points = whole.centers(np.array([3, 12]), np.array([20, 25]))

    part = whole.around(points, 0.4)

    assert part.cells.shape == (17, 14)
    around = part.centers(*np.indices(part.cells.shape))
    assert np.array_equal(whole.at(around), part.cells)
    assert whole.around(np.array([[50.0, 50.0]]), 0.1).cells.shape == (1, 1)
