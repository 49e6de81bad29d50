"""The sweep of a plan, arc by arc, past all that it must not touch; its clearance for displays."""

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Decision
from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS
from cmpsp_ros.guidance.prediction.estimator import ObstacleTracker, as_expected, within_reach
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.guidance.world import World
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.motion import (
    Kinematics,
    arc_from,
    arc_of,
    arc_of_point,
    fastest_wheel,
    point_of,
)
from cmpsp_ros.world import SpaceData
from cmpsp_ros.world.obstacles import ROUGHNESS, disc_after, distance_from, sweep, sweep_moving
from cmpsp_ros.world.roads import road_functions


class PlanSweep(NamedTuple):
    """Result of `sweep_plan`: clearances [m]; committed steps must be clear of all that stands.

    Obstacles are numbered: both edges of the road first, then static ones, then moving discs.
    """

    fastest: float  # maximum wheel speed [rad/s]
    committed: float  # minimum clearance of the committed steps
    worst: float  # minimum clearance of the whole plan
    nearest: float  # index of the obstacle of `worst`
    shortfall: float  # largest clearance from what stands still that the committed steps lack
    short_of: float  # index of the obstacle of `shortfall`
    tightest: float  # clearance from that
    edges: float  # minimum clearance of the whole plan from the road's edges
    others: float  # the same from all other obstacles


SWEEP: Final = np.dtype([(name, np.float64) for name in PlanSweep._fields])  # the same, compiled

# With `safety.between_samples` off only the samples are held clear, and an active constraint is
# met there to the accuracy of a linearisation.
_SAMPLE_TOLERANCE = 1e-3


@allocation_free
def sweep_plan(
    found: NDArray[np.void],  # filled with the result, one record of `SWEEP`
    scratch: Array,  # shape ``(2, 2 + M + D)``
    pose: Array,  # where it begins ``(3,)``
    controls: Array,
    durations: Array,
    robot: Kinematics,
    committed: int,  # number of steps that must be clear
    between: bool,  # whether the path between samples counts
    space: SpaceData,  # of all that stands still
    moving: Array,  # states at the beginnings of steps ``(N, D, 7)``
    progress: float,  # arc length of a place near the pose [m]
) -> None:
    """Drive a plan arc by arc, with every disc of the robot: each drives an arc of its own."""
    result, fastest = found[0], 0.0
    road, shapes, radii, discs = space
    for k in range(controls.shape[0]):
        # `max` drops NaN, a sum propagates it.
        speed = fastest_wheel(controls, k, robot)
        fastest = max(fastest, speed) + 0.0 * speed
    result.fastest = fastest
    x, y, heading = pose[0], pose[1], pose[2]
    progress = road_functions.project(road, x, y, heading, progress)
    worst, at_rest = scratch[0], scratch[1]
    moved = N_EDGE_CONSTRAINTS + radii.shape[1]
    # A robot that is too close already must not get closer than at rest.
    for i in range(discs.shape[0]):
        there_x, there_y = point_of(x, y, heading, discs, i)
        at, _, over, over_other = road_functions.lateral_error(road, 0, there_x, there_y, progress)
        progress = at if i == 0 else progress
        _keep_least(at_rest, 0, i, -over)
        _keep_least(at_rest, 1, i, -over_other)
        for j in range(radii.shape[1]):
            distance = distance_from(shapes, 0, j, there_x, there_y) - radii[0, j]
            if shapes.first[j + 1] - shapes.first[j] != 1:
                distance -= ROUGHNESS
            _keep_least(at_rest, N_EDGE_CONSTRAINTS + j, i, distance)
    for k in range(durations.shape[0]):
        whole = arc_of(x, y, heading, controls, k, durations[k], robot)
        before, begin_heading = progress, heading
        x, y, heading = whole.end_x, whole.end_y, heading + whole.turn
        if not between:
            # Only the arc's end counts.
            whole, begin_heading = arc_from(x, y, heading, 0.0, 0.0), heading
        must = k < committed
        for i in range(discs.shape[0]):
            begins = k == 0 and i == 0
            arc = arc_of_point(whole, begin_heading, discs, i)
            bound, bound_other = (math.inf, math.inf) if begins else (worst[0], worst[1])
            after, clearance, other = road_functions.sweep(road, arc, before, bound, bound_other)
            progress = after if i == 0 else progress
            _record(result, worst, at_rest, begins, 0, clearance, must, between)
            _record(result, worst, at_rest, begins, 1, other, must, between)
            for j in range(radii.shape[1]):
                what = N_EDGE_CONSTRAINTS + j
                bound = math.inf if begins else worst[what] + radii[0, j]
                least = sweep(arc, shapes, j, bound)
                _record(result, worst, at_rest, begins, what, least - radii[0, j], must, between)
            # Where only the samples count, so does only the end of the time.
            begin, lasting = (0.0, durations[k]) if between else (durations[k], 0.0)
            for j in range(moving.shape[1]):
                there_x, there_y, u, v, radius, growth = disc_after(moving[k], j, begin, lasting)
                bound = math.inf if begins else worst[moved + j] + radius
                least = sweep_moving(arc, lasting, there_x, there_y, u, v, growth, bound) - radius
                if must and not least >= result.committed:
                    result.committed = least
                _record(result, worst, at_rest, begins, moved + j, least, False, between)
    nearest, total = 0, 0.0
    for what in range(worst.shape[0]):
        if worst[what] < worst[nearest]:
            nearest = what
        total += worst[what]
    # NaN if any of them is.
    result.worst, result.nearest = worst[nearest] + 0.0 * total, nearest
    result.edges, result.others = min(worst[0], worst[1]), math.inf
    for what in range(N_EDGE_CONSTRAINTS, worst.shape[0]):
        result.others = min(result.others, worst[what])


@allocation_free
def _keep_least(least: Array, what: int, i: int, clearance: float) -> None:
    if i == 0 or clearance < least[what] or math.isnan(clearance):
        least[what] = clearance


@allocation_free
def _record(
    result: Any,
    worst: Array,
    at_rest: Array,
    begins: bool,
    what: int,
    clearance: float,
    must: bool,
    between: bool,
) -> None:
    """Record the clearance of a disc in one step from one thing, and whether it must be clear."""
    if must:
        is_first = begins and what == 0
        allowed = min(at_rest[what], 0.0) - (0.0 if between else _SAMPLE_TOLERANCE)
        if is_first or not clearance >= result.committed:
            result.committed = clearance
        if is_first or not allowed - clearance <= result.shortfall:
            result.shortfall = allowed - clearance
            result.short_of, result.tightest = what, clearance
    # NaN comes in, and nothing replaces it.
    if begins or clearance < worst[what] or math.isnan(clearance):
        worst[what] = clearance


def plan_clearance(settings: LawSettings, world: World, decision: Decision) -> Array:
    """Least clearance ``(N + 1,)`` [m] of a plan from each pose to the next, and at the last.

    Its minimum is the decision's `worst_margin`; ValueError for a decision without a plan.
    """
    plan, radius = decision.plan, settings.robot_radius
    if plan is None:
        raise ValueError('decision: found one without a plan, wanted one with a plan')
    # The end is an arc that takes no time.
    durations = np.append(plan.horizon.durations, 0.0)
    twists = (1.0 - decision.wheel_slip) * settings.robot.twist(plan.controls)
    clearance = world.free_space(settings).along(plan.poses, twists, durations)
    if decision.tracks:
        known = settings.moving_obstacles
        begin = plan.poses[0]
        near = within_reach(decision.tracks, begin, settings.robot.max_speed)
        tracks = as_expected(near, settings.control_period)
        moving = ObstacleTracker().update(decision.stamp, begin, tracks, known)
        times = plan.delay / NANOSECONDS + np.cumsum(durations) - durations
        points = settings.footprint.discs
        discs = moving.grown(radius).along(plan.poses, twists, durations, times, points)
        clearance = np.hstack([clearance, discs])
    return np.asarray(clearance.min(axis=1))
