"""Another way by sight is taken where the present one is blocked, and not to and fro by noise."""

from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.guidance.planning.grid_path_memory import search_ahead
from cmpsp_ros.guidance.world import NOT_SEARCHED
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world.grids import Cell, OccupancyGrid

CELL, SIDE = 0.05, 200
START, GOAL = np.array([0.0, 0.0]), (8.0, 0.0)
MIDDLE = SIDE // 2


@pytest.fixture(scope='module')
def settings():
    return guidance_settings(TABLE.resolve(load_parameter_file('clutter')))


def wall(low, high):
    """A wall across the straight way, from a row to another one, 4 m ahead."""
    cells = np.zeros((SIDE, SIDE), np.uint8)
    cells[low:high, 100:104] = Cell.OCCUPIED
    return cells


def sides(settings, scans, searched=NOT_SEARCHED):
    """Places (y) where the path crosses the wall after each scan [m], and the search."""
    found = []
    for cells in scans:
        world = replace(settings.world, searched=searched)
        seen = world.seeing(OccupancyGrid((-1.0, -5.0, 0.0), CELL, cells))
        searched = search_ahead(settings, seen, START, [GOAL])
        line = replace(seen, searched=searched).map_search(settings).line(START, GOAL, 0.1)
        found.append(float(line[np.abs(line[:, 0] - 4.1).argmin(), 1]))
    return np.array(found), searched


def noisy_walls(count):
    """A wall whose ends are seen now a few cells longer, now shorter."""
    random = np.random.default_rng(7)
    for low, high in random.integers(-3, 4, (count, 2)).tolist():
        yield wall(MIDDLE - 30 + low, MIDDLE + 30 + high)


@pytest.mark.parametrize('reluctance', [0.0, NOT_SEARCHED.hysteresis])
def test_noise_does_not_change_the_side(settings, reluctance):
    crossings, _ = sides(settings, noisy_walls(30), NOT_SEARCHED._replace(hysteresis=reluctance))

    assert (np.abs(crossings) > 1.4).all()
    assert (np.ptp(np.sign(crossings)) > 0.0) == (reluctance == 0.0)


def test_a_way_is_changed_for_one_that_is_clearly_better(settings):
    ends = MIDDLE - 70, MIDDLE - 52, MIDDLE - 20
    crossings, searched = sides(settings, [wall(low, MIDDLE + 60) for low in ends])

    assert (crossings[:2] > 2.9).all()
    assert -2.0 < crossings[2] < -1.0
    assert searched.is_another
    assert searched.hysteresis > NOT_SEARCHED.hysteresis


def test_a_way_that_is_blocked_is_changed_at_once(settings):
    blocked = wall(MIDDLE - 70, SIDE)

    (first, second), searched = sides(settings, [wall(MIDDLE - 70, MIDDLE + 30), blocked])

    assert first > 1.4
    assert second < -1.4
    assert searched.kept is None
    assert searched.hysteresis == NOT_SEARCHED.hysteresis


def test_a_gap_that_noise_opens_and_closes_is_given_up(settings):
    closed = wall(MIDDLE - 60, MIDDLE + 60)
    is_open = closed.copy()
    is_open[MIDDLE - 8 : MIDDLE + 8] = Cell.FREE

    crossings, _ = sides(settings, [closed, is_open] * 20)

    through = np.abs(crossings) < 1.0
    assert through.any()
    assert not through[-20:].any()
