"""Memory of the path across a grid: scans open and block paths."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import Searched, World
from cmpsp_ros.world import FreeSpace, KeptLine, is_beside
from cmpsp_ros.world.grids import GridObstacle, is_free
from cmpsp_ros.world.roads import OpenFloor

Point = tuple[float, float]

_SPACING: Final = 0.1
_MAX_HYSTERESIS: Final = 5.0


def search_ahead(
    settings: LawSettings, world: World, place: Array, goals: Sequence[Point]
) -> Searched:
    """Inputs of the path search of the next control step, and searches for the next goals.

    The hysteresis of a path doubles with each change: noise would make a robot drive to and fro.
    """
    searched = world.searched
    if world.seen is not None:
        find = _by_sight if world.map is None else _with_a_map
        searched = find(settings, world, world.seen, place, goals[0])
        world = replace(world, searched=searched) if searched is not world.searched else world
    search = world.map_search(settings)
    if search is not None:
        for each in goals:
            search.prepare(each)
    return searched


def _by_sight(
    settings: LawSettings, world: World, seen: GridObstacle, place: Array, goal: Point
) -> Searched:
    """Search the seen grid; the path is kept while it is open."""
    before, line = world.searched, _line(settings, world, place, goal)
    if not len(line):
        return before._replace(seen=seen, kept=None, is_another=False)
    # Noise must not give up what is kept, so that half of it will do: the search knows what fits.
    is_open = not _is_blocked(seen, line, settings.kept / 2.0).any()
    kept = KeptLine(line, before.hysteresis) if is_open else None
    found = before._replace(seen=seen, kept=kept)
    found_line = _line(settings, replace(world, searched=found), place, goal)
    is_another = not is_beside(found_line, line)
    if is_another and is_open:
        found = _with_more_hysteresis(found)
    return found._replace(is_another=is_another)


def _with_a_map(
    settings: LawSettings, world: World, seen: GridObstacle, place: Array, goal: Point
) -> Searched:
    """Search the map with the obstacles that blocked its path, until all are seen to be free."""
    before, line = world.searched, _line(settings, world, place, goal)
    # A line strays by half a cell at corners.
    body = settings.robot_radius - seen.grid.resolution / 2.0
    if _is_blocked(seen, line, body).any():
        found = before._replace(seen=seen, is_another=True)
        line = _line(settings, replace(world, searched=found), place, goal)
        return found if len(line) else before
    alone = before._replace(seen=None, is_another=True)
    other = _line(settings, replace(world, searched=alone), place, goal)
    if before.seen is None or _is_blocked(seen, other, body).any():
        return before
    blocked = other[_is_blocked(before.seen, other, body)]
    is_shorter = 0 < len(other) * (1.0 + before.hysteresis) < len(line)
    is_open = is_shorter and is_free(seen.grid.at(blocked)).all()
    return _with_more_hysteresis(alone) if is_open else before


def _with_more_hysteresis(searched: Searched) -> Searched:
    return searched._replace(hysteresis=min(2.0 * searched.hysteresis, _MAX_HYSTERESIS))


def _line(settings: LawSettings, world: World, place: Array, goal: Point) -> Array:
    search = world.map_search(settings)
    return np.empty((0, 2)) if search is None else search.line(place, goal, _SPACING)


def _is_blocked(seen: GridObstacle, line: Array, distance: float) -> BoolArray:
    """Points of a line that are nearer to what is seen than a distance [m], shape ``(K,)``."""
    poses = np.column_stack([line, np.zeros(len(line))])
    clearance = FreeSpace.of(OpenFloor(), (seen,), distance).at(poses)[:, 2]
    return np.asarray(clearance < 0.0)
