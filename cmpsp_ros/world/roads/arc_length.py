"""Arc length along the centre line of a road: of poses, between them, and to a goal."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.world.roads import road_functions
from cmpsp_ros.world.roads.road import Road
from cmpsp_ros.world.roads.road_functions import RoadSpace

Point = tuple[float, float]

# Distance beyond an edge that no driving robot reaches, as a fraction of the road's width.
_FAR: Final = 0.25


def arc_length_to(
    road: Road, pose: Array, goal: Point, heading: float | None = None, progress: float = math.nan
) -> float:
    """Arc length of the centre line from a pose to a goal, negative against its direction [m].

    The heading at the goal [rad] and the progress near the pose select the branch, if known.
    """
    return float(remaining_arc_length(road, pose[None], goal, heading, progress)[0])


def lookahead_point(
    road: Road, pose: Array, length: float, progress: float = math.nan
) -> tuple[Point, float]:
    """Point (x, y) [m] an arc length ahead of a pose, negative behind, and direction there."""
    x, y, direction = _ahead(road.space(0.0), pose[0], pose[1], pose[2], length, float(progress))
    return (x, y), direction


def lookahead_points(
    road: Road, pose: Array, lengths: Array, goal: Point, progress: float = math.nan
) -> Array:
    """Points ``(K, 2)`` [m] of the centre line, or on open floor of the line to the goal."""
    points = np.empty((len(lengths), 2))
    _fill_points(points, road.space(0.0), pose, lengths, goal, float(progress))
    return points


def project_on_path(road: Road, pose: Array, before: float) -> float:
    """Arc length of a pose, on the branch of the road along which the robot has come.

    `before` is its last value, NaN at first; NaN for roads that cannot cross themselves.
    """
    if not road.has_progress:
        return math.nan
    far = _FAR * road.width
    return find_near(road.space(0.0), pose[0], pose[1], pose[2], float(before), far)


def remaining_arc_length(
    road: Road, poses: Array, goal: Point, heading: float | None, progress: float = math.nan
) -> Array:
    """Arc lengths ``(K,)`` from each pose of a path to the goal, negative behind it [m]."""
    lengths = np.empty(len(poses))
    there = math.nan if heading is None else heading
    place = float(goal[0]), float(goal[1])
    _fill_remaining(lengths, road.space(0.0), poses, place, float(there), float(progress))
    return lengths


@allocation_free
def find_near(
    road: RoadSpace, x: float, y: float, heading: float, before: float, far: float
) -> float:
    """Arc length of a pose near the last place, or anywhere if it is too far beside that [m]."""
    place: float = road_functions.project(road, x, y, heading, before)
    _, _, over, over_other = road_functions.lateral_error(road, 0, x, y, place)
    if max(over, over_other) > far:
        place = road_functions.project(road, x, y, heading, math.nan)
    return place


@allocation_free
def _ahead(road: RoadSpace, x: float, y: float, heading: float, way: float, progress: float) -> Any:
    here = road_functions.project(road, x, y, heading, progress)
    at_x, at_y = road_functions.point_ahead(road, x, y, here, way, (x, y))
    before_x, before_y = road_functions.point_ahead(road, x, y, here, 0.999 * way, (x, y))
    along = math.atan2(at_y - before_y, at_x - before_x)
    there = road_functions.project(road, at_x, at_y, along, here + way)
    across_x, across_y, _, _, _, _, _ = road_functions.gradients(road, at_x, at_y, there)
    # Along the road, in the sense in which it is driven.
    along_x, along_y = across_y, -across_x
    if along_x * (at_x - before_x) + along_y * (at_y - before_y) < 0.0:
        along_x, along_y = -along_x, -along_y
    return at_x, at_y, math.atan2(along_y, along_x)


@allocation_free
def _fill_points(
    points: Array, road: RoadSpace, pose: Array, lengths: Array, goal: Point, progress: float
) -> None:
    x, y = pose[0], pose[1]
    here = road_functions.project(road, x, y, pose[2], progress)
    for k in range(lengths.shape[0]):
        points[k, 0], points[k, 1] = road_functions.point_ahead(road, x, y, here, lengths[k], goal)


@allocation_free
def _fill_remaining(
    lengths: Array, road: RoadSpace, poses: Array, goal: Point, heading: float, progress: float
) -> None:
    here = road_functions.project(road, poses[0, 0], poses[0, 1], poses[0, 2], progress)
    at_goal = road_functions.project(road, goal[0], goal[1], heading, math.nan)
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        if k > 0:
            here = road_functions.lateral_error(road, 0, x, y, here)[0]
        lengths[k] = road_functions.arc_length_to(road, x, y, here, goal[0], goal[1], at_goal)
