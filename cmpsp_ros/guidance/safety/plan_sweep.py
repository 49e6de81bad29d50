"""The sweep of a plan, arc by arc, past everything that it must not touch: compiled code."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.robots.arcs import arc_from
from cmpsp_ros.robots.kinematics import Kinematics
from cmpsp_ros.robots.robot_functions import arc_of, fastest_wheel
from cmpsp_ros.world.grids.field_functions import Fields
from cmpsp_ros.world.obstacles.moving_discs import RADIUS, VELOCITY_X, VELOCITY_Y, X, Y
from cmpsp_ros.world.obstacles.moving_point_functions import sweep_moving
from cmpsp_ros.world.obstacles.shape_functions import ROUGHNESS, distance_from, sweep
from cmpsp_ros.world.roads import road_functions
from cmpsp_ros.world.roads.road_space import RoadSpace

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FOUND: Final = 9
"""How many numbers `sweep_plan` finds."""

# With `safety.between_samples` off only the samples are held clear, and an active constraint is
# met there to the accuracy of a linearisation.
_SAMPLE_TOLERANCE = 1e-3


@allocation_free
def sweep_plan(
    found: Array,
    scratch: Array,
    pose: Array,
    controls: Array,
    durations: Array,
    robot: Kinematics,
    committed: int,
    between: bool,
    road: RoadSpace,
    fields: Fields,
    corners: Array,
    first: Indices,
    radii: Array,
    moving: Array,
    growth: float,
    progress: float,
) -> None:
    """Drive a plan arc by arc.

    Args:
        found: Filled with the largest wheel speed; the least clearance of the committed steps and
            of the whole plan, and what it is from; by how much those steps fall short of what they
            must keep, what they come too close to, and their clearance from that; the least
            clearance of the whole plan from the road's edges, and from all else. Shape ``(9,)``.
        scratch: Shape ``(2, 2 + M + D)``.
        pose: Where it begins.
        controls: Of the robot.
        durations: Of the steps.
        robot: The robot.
        committed: How many steps must be clear.
        between: Whether the path between samples counts.
        road: Where on it the robot's centre may be.
        fields: The distance fields of obstacles without corners.
        corners: Of the obstacles, as `shape_functions` has them.
        first: Where the corners of each begin.
        radii: Least distances from the obstacles without theirs.
        moving: States of the moving discs at the beginning of each step, shape ``(N, D, 5)``.
        growth: Of their radii [m/s].
        progress: Arc length along the road of a place near the pose [m].
    """
    fastest = 0.0
    for k in range(controls.shape[0]):
        # `max` drops NaN, a sum propagates it.
        speed = fastest_wheel(controls, k, robot)
        fastest = max(fastest, speed) + 0.0 * speed
    found[0] = fastest
    x, y, heading = pose[0], pose[1], pose[2]
    progress = road_functions.project(road, x, y, heading, progress)
    progress, _, over, over_other = road_functions.lateral_error(road, 0, x, y, progress)
    # A robot that is too close already must not get closer: what it keeps if it stands.
    worst, at_rest = scratch[0], scratch[1]
    at_rest[0], at_rest[1] = -over, -over_other
    moved = N_EDGE_CONSTRAINTS + radii.shape[0]
    for j in range(radii.shape[0]):
        distance = distance_from(fields, corners, first, 0, j, x, y)
        at_rest[N_EDGE_CONSTRAINTS + j] = distance - radii[j]
        if first[j + 1] - first[j] != 1:
            at_rest[N_EDGE_CONSTRAINTS + j] -= ROUGHNESS
    standing = durations[0]
    for k in range(1, committed):
        standing += durations[k]
    for j in range(moving.shape[1]):
        at_rest[moved + j] = (
            _clearance_at_rest(moving, j, growth, x, y, standing, between) - ROUGHNESS
        )
    for k in range(durations.shape[0]):
        arc = arc_of(x, y, heading, controls, k, durations[k], robot)
        x, y, heading = arc.end_x, arc.end_y, heading + arc.turn
        if not between:
            # Only the arc's end counts.
            arc = arc_from(x, y, heading, 0.0, 0.0)
        bound, bound_other = (worst[0], worst[1]) if k > 0 else (math.inf, math.inf)
        progress, clearance, other = road_functions.sweep(road, arc, progress, bound, bound_other)
        must = k < committed
        _record(found, worst, at_rest, k, 0, clearance, must, between)
        _record(found, worst, at_rest, k, 1, other, must, between)
        for j in range(radii.shape[0]):
            bound = worst[N_EDGE_CONSTRAINTS + j] + radii[j] if k > 0 else math.inf
            least = sweep(arc, fields, corners, first, j, bound)
            what = N_EDGE_CONSTRAINTS + j
            _record(found, worst, at_rest, k, what, least - radii[j], must, between)
        # Where only the samples count, so does only the end of the time.
        begin, lasting = (0.0, durations[k]) if between else (durations[k], 0.0)
        for j in range(moving.shape[1]):
            radius = moving[k, j, RADIUS] + growth * begin
            u, v = moving[k, j, VELOCITY_X], moving[k, j, VELOCITY_Y]
            there_x, there_y = moving[k, j, X] + begin * u, moving[k, j, Y] + begin * v
            bound = worst[moved + j] + radius if k > 0 else math.inf
            least = sweep_moving(arc, lasting, there_x, there_y, u, v, growth, bound)
            _record(found, worst, at_rest, k, moved + j, least - radius, must, between)
    nearest, total = 0, 0.0
    for what in range(worst.shape[0]):
        if worst[what] < worst[nearest]:
            nearest = what
        total += worst[what]
    # NaN if any of them is.
    found[2], found[3] = worst[nearest] + 0.0 * total, nearest
    found[7], found[8] = min(worst[0], worst[1]), math.inf
    for what in range(N_EDGE_CONSTRAINTS, worst.shape[0]):
        found[8] = min(found[8], worst[what])


@allocation_free
def _clearance_at_rest(
    moving: Array, j: int, growth: float, x: float, y: float, duration: float, between: bool
) -> float:
    """Least clearance from a moving disc of a robot at rest for some time [m]."""
    away_x, away_y = x - moving[0, j, X], y - moving[0, j, Y]
    u, v = moving[0, j, VELOCITY_X], moving[0, j, VELOCITY_Y]
    if between:
        arc = arc_from(x, y, 0.0, 0.0, 0.0)
        there_x, there_y = moving[0, j, X], moving[0, j, Y]
        later = sweep_moving(arc, duration, there_x, there_y, u, v, growth, math.inf)
    else:
        later = math.hypot(away_x - duration * u, away_y - duration * v) - growth * duration
    clearance: float = min(math.hypot(away_x, away_y), later) - moving[0, j, RADIUS]
    return clearance


@allocation_free
def _record(
    found: Array,
    worst: Array,
    at_rest: Array,
    k: int,
    what: int,
    clearance: float,
    must: bool,
    between: bool,
) -> None:
    """Record the clearance of one step from one thing, and whether it must be clear."""
    if must:
        begins = k == 0 and what == 0
        allowed = min(at_rest[what], 0.0) - (0.0 if between else _SAMPLE_TOLERANCE)
        if begins or not clearance >= found[1]:
            found[1] = clearance
        if begins or not allowed - clearance <= found[4]:
            found[4], found[5], found[6] = allowed - clearance, what, clearance
    # NaN comes in, and nothing replaces it.
    if k == 0 or clearance < worst[what] or math.isnan(clearance):
        worst[what] = clearance
