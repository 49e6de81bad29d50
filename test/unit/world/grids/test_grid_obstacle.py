"""A grid as an obstacle: its outlines, its islands, and its clearance beside other shapes."""

import math

import numpy as np
import pytest

from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.world import FreeSpace, outside
from cmpsp_ros.world.grids import Cell, GridError, GridObstacle, OccupancyGrid
from cmpsp_ros.world.grids.grid_obstacle import loops
from cmpsp_ros.world.obstacles import Capsule, Obstacle
from cmpsp_ros.world.roads import OpenFloor

RESOLUTION = 0.1


def map_with(*boxes, unknown_is_free=False):
    cells = np.zeros((40, 60), np.uint8)
    for top, bottom, left, right in boxes:
        cells[top:bottom, left:right] = 1
    return GridObstacle('map', OccupancyGrid((0.0, 0.0, 0.0), RESOLUTION, cells), unknown_is_free)


def area_of(line):
    x, y = line.T
    return float((x[:-1] * y[1:] - x[1:] * y[:-1]).sum() / 2.0)


@pytest.mark.parametrize('seed', range(5))
def test_outlines_enclose_the_cells_and_leave_holes_out(seed):
    cells = np.random.default_rng(seed).random((12, 9)) < 0.5

    lines = [np.column_stack([columns, rows]) for rows, columns in loops(cells)]

    assert sum(map(area_of, lines)) == pytest.approx(cells.sum())
    for line in lines:
        assert line[0].tolist() == line[-1].tolist()
        # Nothing but corners: no two edges in one direction.
        along = np.diff(line, axis=0)
        turns = along[:-1, 0] * along[1:, 1] - along[:-1, 1] * along[1:, 0]
        assert (turns != 0.0).all()


def test_outlines_are_in_metres_and_grow_with_the_distance():
    (edge,) = map_with((10, 20, 20, 40)).outlines(0.0)
    (around,) = map_with((10, 20, 20, 40), unknown_is_free=True).outlines(0.3)

    assert edge.min(axis=0).tolist() == pytest.approx([2.0, 1.0])
    assert edge.max(axis=0).tolist() == pytest.approx([4.0, 2.0])
    assert around.min(axis=0).tolist() == pytest.approx([1.7, 0.7], abs=RESOLUTION)
    assert area_of(around) > area_of(edge)


def test_islands_are_what_can_be_passed_on_either_side():
    shape = map_with((10, 20, 20, 24), (0, 8, 40, 41), (30, 33, 50, 53))

    assert shape.islands.tolist() == [
        pytest.approx([2.2, 1.5], abs=RESOLUTION),
        pytest.approx([5.15, 3.15], abs=RESOLUTION),
    ]


def test_a_grid_is_one_column_beside_other_shapes():
    shapes = (
        Obstacle('a', (1.0, 1.0), 0.2),
        map_with((10, 20, 20, 40)),
        Capsule('c', (5, 1), (5, 3), 0.1),
    )
    space = FreeSpace.of(OpenFloor(), shapes, 0.15)

    found = space.at(np.array([[1.5, 1.5, 0.0]]))[0, 2:]

    wanted = [math.hypot(0.5, 0.5) - 0.35, 0.5 - 0.15, 3.5 - 0.25]
    np.testing.assert_allclose(found, wanted, atol=0.01)
    assert (found <= np.array(wanted) + 1e-12).all()
    assert np.isnan(space.centers[1]).all()
    assert np.isfinite(space.centers[[0, 2]]).all()
    assert len(space.landmarks) == 4
    moving = space.with_points(np.ones((3, 1, 2)), np.full((3, 1), 0.5))
    assert moving.at(np.tile([1.5, 1.5, 0.0], (3, 1)))[:, 3] == pytest.approx([found[1]] * 3)


@pytest.mark.parametrize('seed', range(3))
def test_samples_that_keep_the_bound_keep_every_arc_clear(seed):
    """The bound between samples is one for every point, and so for any set of them."""
    random, limits, period = np.random.default_rng(seed), TwistLimits(1.0, 4.0, 0.1), 0.2
    shape = map_with(*(tuple(np.sort(random.integers(1, 39, 2))) * 2 for _ in range(3)))
    space = FreeSpace.of(OpenFloor(), (shape,), 0.2)
    samples = space.tightened(limits, period)
    assert samples.radii.tolist() == [outside(0.2, limits, period)]
    poses = random.uniform([0, 0, -3], [6, 4, 3], (4000, 3))
    turn_rates = random.uniform(-4.0, 4.0, len(poses))
    twists = np.column_stack([1.0 - 0.1 * np.abs(turn_rates), turn_rates])
    ends = poses.copy()
    half = poses[:, 2] + turn_rates * period / 2.0
    chord = twists[:, 0] * period * np.sinc(turn_rates * period / math.tau)
    ends[:, :2] += chord[:, None] * np.column_stack([np.cos(half), np.sin(half)])
    kept = (samples.at(poses)[:, 2] >= 0.0) & (samples.at(ends)[:, 2] >= 0.0)

    between = space.along(poses[kept], twists[kept], np.full(kept.sum(), period))

    assert kept.sum() > 300
    # A check of an arc may err by what is lost between nodes.
    assert between[:, 2].min() > -0.02


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
