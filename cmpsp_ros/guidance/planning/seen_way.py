"""Which way across a map is open: what sensors see counts once it blocks the one that is known."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import MAP, SEEN, GuidanceSettings
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.grids.grid_obstacle import GridObstacle
from cmpsp_ros.world.grids.occupancy_grid import Cell
from cmpsp_ros.world.roads.open_floor import OpenFloor

Array = NDArray[np.float64]

_SPACING: Final = 0.1


def searched_with(
    settings: GuidanceSettings, place: Array, goal: tuple[float, float]
) -> GridObstacle | None:
    """What the way from a place to the goal is to be searched with, beside the map.

    A search takes longer than a control step may, so the last one counts until the way that it
    found is blocked. The way of the map alone counts again once all that blocked it is seen to be
    free: what is only forgotten may still be there.

    Args:
        settings: With what is seen now, and what was seen when a way was searched last.
        place: Where the robot is, shape ``(2,)`` [m].
        goal: Where it is to go (x, y) [m].

    Returns:
        What was seen then, what is seen now, or None for the map alone.
    """
    seen, before = settings.grid(SEEN), settings.searched
    if seen is None or settings.grid(MAP) is None:
        return None
    if before is not None:
        line = _line(settings, None, place, goal)
        blocked = line[_is_blocked(settings, before, line)]
        is_seen = (seen.grid.at(blocked) == Cell.FREE).all()
        if is_seen and not _is_blocked(settings, seen, line).any():
            return None
    if _is_blocked(settings, seen, _line(settings, before, place, goal)).any():
        return seen if len(_line(settings, seen, place, goal)) else before
    return before


def _line(
    settings: GuidanceSettings,
    searched: GridObstacle | None,
    place: Array,
    goal: tuple[float, float],
) -> Array:
    search = replace(settings, searched=searched).map_search
    return np.empty((0, 2)) if search is None else search.line(place, goal, _SPACING)


def _is_blocked(settings: GuidanceSettings, seen: GridObstacle, line: Array) -> NDArray[np.bool_]:
    """Whether the robot cannot pass points, shape ``(K,)``."""
    poses = np.column_stack([line, np.zeros(len(line))])
    clearance = FreeSpace.of(OpenFloor(), (seen,), settings.kept / 2.0).at(poses)[:, 2]
    return np.asarray(clearance < 0.0)
