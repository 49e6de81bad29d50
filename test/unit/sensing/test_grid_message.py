"""Grids as messages: maps, costmaps, their changes, and what is refused."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from cmpsp_ros.sensing import REMEMBERED, grid_of, updated
from cmpsp_ros.world.grids import Cell, GridError

FREE, OCCUPIED, UNKNOWN = Cell.FREE, Cell.OCCUPIED, Cell.UNKNOWN


def turned(yaw):
    return SimpleNamespace(x=0.0, y=0.0, z=math.sin(yaw / 2.0), w=math.cos(yaw / 2.0))


def grid(data=(0, 100, -1, 64, 65, 0), *, frame='map', wide=3, high=2, resolution=0.1, **origin):
    position = SimpleNamespace(x=origin.get('x', 1.0), y=origin.get('y', 2.0), z=0.0)
    pose = SimpleNamespace(position=position, orientation=origin.get('turn', turned(0.5)))
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=frame),
        info=SimpleNamespace(resolution=resolution, width=wide, height=high, origin=pose),
        data=data,
    )


def change(data, *, x, y, wide, high):
    return SimpleNamespace(x=x, y=y, width=wide, height=high, data=data)


def test_cells_origin_and_resolution():
    found = grid_of(grid(), 'map')
    assert found.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN], [FREE, OCCUPIED, FREE]]
    assert found.origin == pytest.approx((1.0, 2.0, 0.5))
    assert found.resolution == 0.1
    # Half a cell along its first row, which is turned.
    point = [1.0 + 0.15 * math.cos(0.5) - 0.05 * math.sin(0.5)]
    point.append(2.0 + 0.15 * math.sin(0.5) + 0.05 * math.cos(0.5))
    assert found.at(np.array(point)) == OCCUPIED


def test_what_is_lethal_can_be_said():
    assert grid_of(grid(), 'map', lethal=100).cells.tolist() == [
        [FREE, OCCUPIED, UNKNOWN],
        [FREE, FREE, FREE],
    ]


def test_free_cells_out_of_sight_come_back_as_such():
    found = grid_of(grid((0, REMEMBERED, 2, -1, 100, 0)), 'map')
    assert found.cells.tolist() == [[FREE, Cell.REMEMBERED, FREE], [UNKNOWN, OCCUPIED, FREE]]


def test_a_change_of_a_part():
    before = grid_of(grid(), 'map')
    after = updated(before, change((100, -1), x=1, y=1, wide=2, high=1))
    assert after.cells.tolist() == [[FREE, OCCUPIED, UNKNOWN], [FREE, OCCUPIED, UNKNOWN]]
    assert before.cells[1, 2] == FREE
    assert (after.origin, after.resolution) == (before.origin, before.resolution)


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (grid(frame='odom'), "frame_id: found 'odom', wanted 'map'"),
        (grid((), wide=0), 'cells: found 2 x 0, wanted 1 to'),
        (grid(wide=10**5, high=10**4), 'cells: found 10000 x 100000, wanted 1 to'),
        (grid((0,) * 5), 'data: found 5 values, wanted 6 for 3 x 2'),
        (grid(x=math.nan), 'origin: found'),
        (grid(y=-math.inf), 'origin: found'),
        (grid(x=1e9), 'origin: found .* wanted a place on Earth'),
        (grid(resolution=0.0), 'resolution: found 0.0 m'),
        (grid(resolution=math.nan), 'resolution: found nan m'),
        (grid(turn=SimpleNamespace(x=0.0, y=0.0, z=0.0, w=0.0)), 'origin.orientation: found'),
        (grid(turn=SimpleNamespace(x=1.0, y=0.0, z=0.0, w=0.0)), 'about the vertical'),
        (grid(turn=turned(math.nan)), 'origin.orientation: found'),
    ],
)
def test_a_grid_that_is_refused(message, reason):
    with pytest.raises(GridError, match=reason):
        grid_of(message, 'map')


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (change((0,) * 4, x=2, y=0, wide=2, high=2), '2 x 2 cells at 2, 0, wanted a part of'),
        (change((0,), x=0, y=-1, wide=1, high=1), 'wanted a part of a grid of 3 x 2'),
        (change((0,), x=0, y=0, wide=2, high=1), 'data: found 1 values, wanted 2 for 2 x 1'),
        (change((), x=0, y=0, wide=0, high=1), 'cells: found 1 x 0'),
    ],
)
def test_a_change_that_is_refused(message, reason):
    with pytest.raises(GridError, match=reason):
        updated(grid_of(grid(), 'map'), message)
