"""Where to be and when; and following a road that has no end."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.world.roads import road_functions
from cmpsp_ros.world.roads.corridor import Corridor
from cmpsp_ros.world.roads.road import Road
from cmpsp_ros.world.roads.road_space import RoadSpace

Array = NDArray[np.float64]
Point = tuple[float, float]

# Beyond an edge, as a part of the road's width: farther than a robot comes that drives.
_FAR: Final = 0.25


@dataclass(frozen=True)
class Goal:
    """A point to pass at a time.

    Attributes:
        position: The point (x, y) [m].
        time: When to pass it, from the first odometry [s].
        heading: Heading to pass it with [rad]; None for any.
        name: By which decisions tell it from others; empty where there is but one.
    """

    position: Point
    time: float
    heading: float | None = None
    name: str = ''


@dataclass(frozen=True)
class Follow:
    """Following the road at a speed, without an end.

    Attributes:
        speed: Mean speed along the centre line, negative against its direction [m/s].
        horizon: Time that plans look ahead [s].
    """

    speed: float
    horizon: float

    @property
    def way(self) -> float:
        """Way along the centre line within the horizon, negative against its direction [m]."""
        return self.speed * self.horizon


def way_along(
    road: Road, pose: Array, goal: Point, heading: float | None = None, near: float = math.nan
) -> float:
    """Way along the centre line from a pose to a goal, negative against its direction [m].

    Args:
        road: The road.
        pose: Where it begins, shape ``(3,)`` [m, m, rad].
        goal: Where it leads (x, y) [m].
        heading: At the goal: says which way is meant where the road crosses itself [rad].
        near: Progress of a place near the pose, not a number where none is known [m].
    """
    there = math.nan if heading is None else heading
    return _way(road.space(0.0), pose[0], pose[1], pose[2], *goal, there, float(near))


def line_ahead(road: Road, pose: Array, way: float, near: float = math.nan) -> tuple[Point, float]:
    """Place of the centre line that is some way ahead of a pose.

    Args:
        road: A road with a centre line.
        pose: Shape ``(3,)`` [m, m, rad].
        way: Along the centre line, negative against its direction [m].
        near: Progress of a place near the pose, not a number where none is known [m].

    Returns:
        The place (x, y) [m], and the direction in which the road is driven there [rad].
    """
    x, y, direction = _ahead(road.space(0.0), pose[0], pose[1], pose[2], way, float(near))
    return (x, y), direction


def place_of(road: Road, pose: Array, before: float) -> float:
    """Progress of a pose, on the branch of the road that the robot has come along.

    A robot that gives way to something where the road crosses itself may turn towards the other
    branch: its heading does not say then where it is.

    Args:
        road: The road.
        pose: Shape ``(3,)`` [m, m, rad].
        before: Progress when it was last known, not a number at first [m].

    Returns:
        Progress [m]; not a number where the road crosses itself nowhere by its nature. A pose that
        is far beside the road where it was before has been moved there, and is found afresh.
    """
    if not isinstance(road, Corridor):
        return math.nan
    return _place(road.space(0.0), pose[0], pose[1], pose[2], float(before), _FAR * road.width)


@allocation_free
def _place(road: RoadSpace, x: float, y: float, heading: float, before: float, far: float) -> float:
    place: float = road_functions.find(road, x, y, heading, before)
    _, _, over, over_other = road_functions.measure(road, 0, x, y, place)
    if max(over, over_other) > far:
        place = road_functions.find(road, x, y, heading, math.nan)
    return place


@allocation_free
def _way(
    road: RoadSpace,
    x: float,
    y: float,
    heading: float,
    goal_x: float,
    goal_y: float,
    there: float,
    near: float,
) -> float:
    here = road_functions.find(road, x, y, heading, near)
    at_goal = road_functions.find(road, goal_x, goal_y, there, math.nan)
    way: float = road_functions.way_to(road, x, y, here, goal_x, goal_y, at_goal)
    return way


@allocation_free
def _ahead(road: RoadSpace, x: float, y: float, heading: float, way: float, near: float) -> Any:
    here = road_functions.find(road, x, y, heading, near)
    at_x, at_y = road_functions.ahead(road, x, y, here, way, (x, y))
    before_x, before_y = road_functions.ahead(road, x, y, here, 0.999 * way, (x, y))
    along = math.atan2(at_y - before_y, at_x - before_x)
    there = road_functions.find(road, at_x, at_y, along, here + way)
    across_x, across_y, _, _, _, _, _ = road_functions.slopes(road, at_x, at_y, there)
    # Along the road, in the sense in which it is driven.
    along_x, along_y = across_y, -across_x
    if along_x * (at_x - before_x) + along_y * (at_y - before_y) < 0.0:
        along_x, along_y = -along_x, -along_y
    return at_x, at_y, math.atan2(along_y, along_x)
