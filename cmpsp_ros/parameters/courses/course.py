"""Whether a course was given, and where a robot may be on it.

The default values are a course, too; no robot must drive that one by mistake.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Final

import numpy as np

from cmpsp_ros.parameters.courses.obstacles import in_obstacle_problems, obstacles_of
from cmpsp_ros.parameters.courses.roads import known_road, off_road_problems
from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.robots.footprints import KEY as FOOTPRINT
from cmpsp_ros.parameters.robots.footprints import footprint_of
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Point
from cmpsp_ros.world.roads import OpenFloor

_CLEAR: Final = f'a place where {FOOTPRINT} is clear'
_ROUNDING: Final = 1e-9


def course_problems(values: Values, given: Collection[str]) -> Iterator[Problem]:
    """Problems if the course is incomplete: it needs a road, and a goal or a speed to follow it.

    Args:
        values: A set resolved by the table.
        given: Keys given by the user; all others are defaults.
    """
    if not any(key.startswith('road.') for key in given):
        wanted = 'the road of the course: annulus, corridor or none, with what belongs to it'
        yield Problem('road.type', 'nothing', wanted)
    if not values['follow.speed'] and 'goal.position' not in given:
        yield Problem('goal.position', 'nothing', 'the goal of the course, or follow.speed')


def start_problems(values: Values) -> Iterator[Problem]:
    """A start that is no pose."""
    pose = values['start.pose']
    if len(pose) not in (0, 3):
        yield Problem('start.pose', describe(pose), 'x, y and heading, or none of them')


def place_problems(
    values: Values, key: str, point: Point, heading: float | None = None
) -> Iterator[Problem]:
    """Problems if the robot, without its margin, cannot be at a point [m].

    Args:
        values: A set resolved by the table.
        key: Of the point.
        point: The point [m].
        heading: That it has there; None for any [rad].
    """
    if values[FOOTPRINT]:
        yield from _body_problems(values, key, point, heading)
    else:
        yield from off_road_problems(values, key, point)
        yield from in_obstacle_problems(values, key, point)


def _body_problems(
    values: Values, key: str, point: Point, heading: float | None
) -> Iterator[Problem]:
    """Problems of a footprint with corners; where its heading is free, of what is inside it."""
    road = known_road(values) or OpenFloor()
    try:
        obstacles = obstacles_of(values)
    except ParameterError:
        # A problem of its own.
        return
    footprint, radius = footprint_of(values)
    around = (footprint.inscribed,) if heading is None else (radius, footprint.discs)
    pose = np.array([[*point, 0.0 if heading is None else heading]])
    clearance = FreeSpace.of(road, obstacles, *around).at(pose)[0]
    names = (*road.edge_names, *(f'obstacle {each.name}' for each in obstacles))
    for name, away in zip(names, clearance.tolist(), strict=True):
        if away < -_ROUNDING:
            yield Problem(key, f'{-away:.3g} m inside or beyond {name}', _CLEAR)
    if road.beyond(point) > _ROUNDING:
        found = f'{road.beyond(point):.9g} m beyond the end of the road'
        yield Problem(key, found, 'a point between its first and its last point')
