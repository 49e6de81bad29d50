"""A map and a scanner together: either may say that something is there, both what is known."""

import math
from dataclasses import replace

import numpy as np
import pytest
from seeing import Drive

from cmpsp_ros.guidance import MAP, SEEN, FallbackLevel
from cmpsp_ros.guidance.planning.grid_path_memory import search_ahead
from cmpsp_ros.guidance.world import NOT_SEARCHED
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file, text_of
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import Cell, OccupancyGrid

SCANNER = {
    'sensors.names': ['front'],
    'sensors.front.reach': 6.0,
    'sim.scan.rate': 10.0,
    'sim.scan.count': 720,
    'sim.scan.stddev': 0.01,
}


def crate(*vertices):
    return {
        'sim.obstacles.names': ['crate'],
        'sim.obstacles.crate.type': 'polygon',
        'sim.obstacles.crate.vertices': list(vertices),
    }


def box(left, bottom, right, top):
    return crate(left, bottom, right, bottom, right, top, left, top)


def test_what_is_not_on_the_map_is_seen_and_passed():
    around = {'goal.position': [3.8, 3.0], 'final_time': 18.0}
    drive = Drive('warehouse', **SCANNER, **around, **box(2.9, 0.9, 3.5, 1.6))

    assert drive.clearance > 0.0
    assert math.dist(drive.pose[:2], drive.settings.goal) < 0.02
    assert drive.law.world.searched.seen is None


def test_another_way_is_found_where_what_is_seen_blocks_that_of_the_map():
    # Below the first rack; above it there is another way.
    drive = Drive('warehouse', **SCANNER, final_time=110.0, **box(2.2, 0.1, 2.6, 1.55), end=12.0)

    assert drive.clearance > 0.0
    assert drive.law.world.searched.seen is not None
    assert drive.pose[0] < 2.0
    assert drive.pose[1] > 3.0
    assert all(each.level != FallbackLevel.STOP for each in drive.decisions)
    assert not any(drive.searches[1:])


@pytest.mark.parametrize('is_known', [False, True])
def test_a_map_that_knows_the_road_ahead_makes_the_robot_no_slower(is_known):
    cells = np.full((80, 260), Cell.FREE, np.uint8)
    known = {'map.cells': text_of(cells), 'map.origin': [-1.5, -2.0, 0.0], 'map.resolution': 0.05}
    drive = Drive(
        **{
            'robot.max_wheel_speed': 42.0,
            'robot.max_wheel_acceleration': 100.0,
            'final_time': 8.0,
            'sim.obstacles.names': [],
            'sensors.front.reach': 1.0,
            'sim.scan.range_max': 1.0,
        },
        **(known if is_known else {}),
        end=3.0,
    )

    fastest = max(each.twist[0] for each in drive.decisions)
    assert (fastest > 1.2) == is_known
    assert drive.clearance > 0.0


WAREHOUSE = guidance_settings(TABLE.resolve(load_parameter_file('warehouse')))


def world_with(cells):
    """The warehouse, and what is seen on a grid of its own cells."""
    return WAREHOUSE.world.seeing(OccupancyGrid((0.0, 0.0, 0.0), 0.05, cells))


def test_a_way_is_searched_anew_only_when_it_is_blocked():
    start, goal, nothing = np.array([1.0, 1.0]), (11.0, 7.0), np.zeros((160, 240), np.uint8)
    free, blocked, far = world_with(nothing), nothing.copy(), nothing.copy()
    blocked[:35, 45:50] = Cell.OCCUPIED
    far[100:120, 150:170] = Cell.OCCUPIED

    assert search_ahead(WAREHOUSE, free, start, [goal]) is NOT_SEARCHED
    assert search_ahead(WAREHOUSE, world_with(far), start, [goal]) is NOT_SEARCHED
    first = world_with(blocked)
    searched = search_ahead(WAREHOUSE, first, start, [goal])
    assert searched.seen is first.seen
    assert searched.is_another
    # What is seen next is a little different: the way that was found is still open.
    blocked[0, 0] = Cell.OCCUPIED
    next_one = replace(world_with(blocked), searched=searched)
    assert search_ahead(WAREHOUSE, next_one, start, [goal]) is searched
    # What is out of sight and forgotten may be there; what is seen to be gone is not.
    forgotten = nothing.copy()
    forgotten[:40] = Cell.UNKNOWN
    for cells, expected in ((forgotten, searched.seen), (nothing, None)):
        later = replace(world_with(cells), searched=searched)
        assert search_ahead(WAREHOUSE, later, start, [goal]).seen is expected


def test_who_was_led_back_to_the_way_of_the_map_gives_it_up_at_last():
    start, goal, nothing = np.array([1.0, 1.0]), (11.0, 7.0), np.zeros((160, 240), np.uint8)
    blocked, searched, found = nothing.copy(), NOT_SEARCHED, []
    blocked[:35, 45:50] = Cell.OCCUPIED

    for cells in [blocked, nothing] * 10:
        searched = search_ahead(
            WAREHOUSE, replace(world_with(cells), searched=searched), start, [goal]
        )
        found.append(searched.seen is None)

    assert any(found)
    assert not any(found[-10:])


def test_both_grids_keep_the_robot_away_each_by_its_own_distance():
    cells = np.zeros((160, 240), np.uint8)
    cells[80:84, 130:134] = Cell.OCCUPIED
    world = world_with(cells)
    space = FreeSpace.of(world.road, world.shapes, 0.1)
    names = [each.name for each in world.shapes]

    found = space.at(np.array([[6.0, 4.1, 0.0], [1.75, 4.0, 0.0]]))[:, 2:]

    assert found[0, names.index(SEEN)] == pytest.approx(0.5 - 0.1, abs=0.01)
    assert found[1, names.index(MAP)] == pytest.approx(0.25 - 0.1, abs=0.01)
    assert found[1, names.index(SEEN)] > 4.0
