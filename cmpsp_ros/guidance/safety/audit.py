"""The check before any command leaves, which does not trust the solver or share its code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.formulation.ocp_functions import EDGES
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.robots.arcs import arc_from
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.obstacles.moving_discs import (
    NOTHING_MOVES,
    RADIUS,
    VELOCITY_X,
    VELOCITY_Y,
    MovingDiscs,
    X,
    Y,
)
from cmpsp_ros.world.obstacles.shape_functions import ROUGHNESS, distance_from, sweep, sweep_moving
from cmpsp_ros.world.roads import road_functions
from cmpsp_ros.world.roads.road_space import RoadSpace

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# With `safety.between_samples` off only the samples are held clear, and an active constraint is
# met there to the accuracy of a linearisation.
_SAMPLE_TOLERANCE = 1e-3

# A command that was good when it was given is judged again from odometry that has been rounded.
_WAY_TOLERANCE = 1e-6

_FOUND = 9


class Verdict(NamedTuple):
    """Outcome of an audit.

    Attributes:
        passed: Whether the first command may be sent.
        reason: What is wrong, in words; empty when passed.
        margin: Least clearance over the first control period [m].
        worst_margin: Least clearance over the whole plan [m].
        nearest: What the whole plan comes nearest to.
        edge_margin: Least clearance of the whole plan from the road's edges [m].
        obstacle_margin: The same from obstacles and what moves; infinite without any [m].
    """

    passed: bool
    reason: str
    margin: float
    worst_margin: float
    nearest: str
    edge_margin: float
    obstacle_margin: float

    def followed_by(self, later: Verdict) -> Verdict:
        """The verdict on this way and what follows it: both must pass.

        Margins from edges and from obstacles are of what follows, which can still be changed.
        """
        first = self if not self.passed or later.passed else later
        nearer = self if self.worst_margin < later.worst_margin else later
        return Verdict(
            self.passed and later.passed,
            first.reason,
            min(self.margin, later.margin),
            nearer.worst_margin,
            nearer.nearest,
            later.edge_margin,
            later.obstacle_margin,
        )


class Audit:
    """Checks plans: finite, within the wheel limits, first control period swept."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take limits, road and obstacles from the settings."""
        self._robot = settings.model
        self._between = settings.safety.between_samples
        self._radius = settings.robot_radius
        self._space = FreeSpace.of(settings.road, settings.obstacles, settings.robot_radius)
        self._names = (
            *settings.road.edge_names,
            *(f'obstacle {obstacle.name}' for obstacle in settings.obstacles),
        )
        self._found, self._worst = np.empty(_FOUND), np.empty(len(self._names))

    def check(
        self,
        pose: Array,
        controls: Array,
        durations: Array,
        moving: MovingDiscs = NOTHING_MOVES,
        near: float = math.nan,
    ) -> Verdict:
        """Roll a plan out afresh and say whether its first command may be sent.

        A robot that is already outside the road, or inside an obstacle, may only be commanded not
        to get deeper; and where something drives into it, not deeper than if it stood.

        Args:
            pose: Measured pose, shape ``(3,)`` [m, m, rad].
            controls: Wheel speeds ``(N + 1, 2)`` [rad/s].
            durations: Length of every step, shape ``(N,)`` [s].
            moving: What moves, from the pose on.
            near: Progress of a place near the pose, not a number where none is known [m].
        """
        robot = self._robot
        fastest, margin, worst_margin, nearest, shortfall, short, tightest, *of_kinds = self._swept(
            pose, controls, durations, moving, near
        )
        if not math.isfinite(fastest):
            return _refused('The plan has a wheel speed that is not a finite number.')
        if fastest > robot.max_wheel_speed:
            return _refused(
                f'The plan has a wheel speed of {fastest!r} rad/s, the limit is'
                f' {robot.max_wheel_speed!r} rad/s.'
            )
        if not (math.isfinite(margin) and math.isfinite(worst_margin)):
            return _refused('The path of the plan is not finite.')
        reason = ''
        if shortfall > 0.0:
            reason = (
                f'The next {durations[0]:.3g} s would come {-tightest:.3g} m too close'
                f' to {self._name(int(short), moving)}.'
            )
        name = self._name(int(nearest), moving)
        return Verdict(not reason, reason, margin, worst_margin, name, *of_kinds)

    def check_way(
        self,
        pose: Array,
        wheel_speeds: Array,
        durations: Array,
        moving: MovingDiscs = NOTHING_MOVES,
        near: float = math.nan,
    ) -> Verdict:
        """Say whether the way is clear that commands given before will lead.

        The whole of it is swept like the first command of a plan; wheel speeds are not judged
        again.

        Args:
            pose: Where it begins, shape ``(3,)`` [m, m, rad].
            wheel_speeds: Along it ``(K, 2)`` [rad/s], at least one pair.
            durations: For how long each pair holds, shape ``(K,)`` [s].
            moving: What moves, from the pose on.
            near: Progress of a place near the pose, not a number where none is known [m].
        """
        poses = self._robot.roll_out(pose, wheel_speeds, durations)
        begins = np.cumsum(durations) - durations
        arcs = (
            self._check_arc(
                poses[k],
                wheel_speeds[k : k + 1],
                durations[k : k + 1],
                moving.after(float(begins[k])),
                near,
            )
            for k in range(len(durations))
        )
        return reduce(Verdict.followed_by, arcs)

    def _check_arc(
        self,
        pose: Array,
        wheel_speeds: Array,
        duration: Array,
        moving: MovingDiscs,
        near: float,
    ) -> Verdict:
        _, margin, _, nearest, shortfall, short, tightest, *of_kinds = self._swept(
            pose, wheel_speeds, duration, moving, near
        )
        if not math.isfinite(margin):
            return _refused('The way under the commands given before is not finite.')
        reason = ''
        if shortfall > _WAY_TOLERANCE:
            reason = (
                f'The commands given before come {-tightest:.3g} m too close'
                f' to {self._name(int(short), moving)}.'
            )
        name = self._name(int(nearest), moving)
        return Verdict(not reason, reason, margin, margin, name, *of_kinds)

    def _swept(
        self, pose: Array, controls: Array, durations: Array, moving: MovingDiscs, near: float
    ) -> list[float]:
        robot, space, found = self._robot, self._space, self._found
        _sweep(
            found,
            np.empty(len(self._names) + len(moving)) if len(moving) else self._worst,
            pose,
            controls,
            durations,
            robot.wheel_radius,
            robot.half_track,
            self._between,
            space.road,
            space.corners,
            space.first,
            space.radii,
            moving.grown(self._radius).legs(durations),
            moving.growth,
            float(near),
        )
        values: list[float] = found.tolist()
        return values

    def at(self, pose: Array, moving: MovingDiscs = NOTHING_MOVES, near: float = math.nan) -> Array:
        """Clearance of a pose from both road edges, obstacles and what moves ``(2 + M,)`` [m]."""
        standing = self._space.at(pose[None], near)[0]
        if not len(moving):
            return np.asarray(standing)
        return np.concatenate([standing, moving.clearance(pose) - self._radius])

    def names(self, constraints: Sequence[int], moving: MovingDiscs = NOTHING_MOVES) -> str:
        """Names of path constraints by their index, for messages."""
        known, slots = len(self._names), moving.slots.tolist()
        places = [i if i < known else known + slots.index(i - known) for i in constraints]
        return ', '.join(self._name(index, moving) for index in places)

    def _name(self, index: int, moving: MovingDiscs) -> str:
        """What a column of the clearance is about."""
        known = len(self._names)
        return self._names[index] if index < known else moving.names[index - known]


@allocation_free
def _sweep(
    found: Array,
    worst: Array,
    pose: Array,
    controls: Array,
    durations: Array,
    wheel_radius: float,
    half_track: float,
    between: bool,
    road: RoadSpace,
    corners: Array,
    first: Indices,
    radii: Array,
    moving: Array,
    growth: float,
    near: float,
) -> None:
    """Drive a plan arc by arc.

    Args:
        found: Filled with the largest wheel speed; the least clearance of the first step and of
            the whole plan, and what it is from; by how much the first step falls short of what it
            must keep, what it comes too close to, and its clearance from that; the least clearance
            of the whole plan from the road's edges, and from all else. Shape ``(9,)``.
        worst: Scratch, shape ``(2 + M + D,)``.
        pose: Where it begins.
        controls: Wheel speeds.
        durations: Of the steps.
        wheel_radius: Of the robot.
        half_track: Of the robot.
        between: Whether the way between samples counts.
        road: Where on it the robot's centre may be.
        corners: Of the obstacles, as `shape_functions` has them.
        first: Where the corners of each begin.
        radii: Least distances from the obstacles without theirs.
        moving: States of the discs that move at the beginning of each step, shape ``(N, D, 5)``.
        growth: Of their radii [m/s].
        near: Progress of a place near the pose [m].
    """
    fastest = 0.0
    for k in range(controls.shape[0]):
        for a in range(2):
            # The sum carries a number that is not one, which no comparison does.
            fastest = max(fastest, abs(controls[k, a])) + 0.0 * controls[k, a]
    found[0] = fastest
    x, y, heading = pose[0], pose[1], pose[2]
    progress = road_functions.find(road, x, y, heading, near)
    progress, _, over, over_other = road_functions.measure(road, 0, x, y, progress)
    worst[0], worst[1] = -over, -over_other
    moved = EDGES + radii.shape[0]
    for j in range(radii.shape[0]):
        worst[EDGES + j] = distance_from(corners, first, 0, j, x, y) - radii[j]
        if first[j + 1] - first[j] > 1:
            worst[EDGES + j] -= ROUGHNESS
    for j in range(moving.shape[1]):
        worst[moved + j] = _standing(moving, j, growth, x, y, durations[0], between) - ROUGHNESS
    for k in range(durations.shape[0]):
        right, left = controls[k, 0] * wheel_radius, controls[k, 1] * wheel_radius
        length = (right + left) / 2.0 * durations[k]
        turn = (right - left) / (2.0 * half_track) * durations[k]
        arc = arc_from(x, y, heading, length, turn)
        x, y, heading = arc.end_x, arc.end_y, heading + turn
        if not between:
            # Only the arc's end counts.
            arc = arc_from(x, y, heading, 0.0, 0.0)
        enough, enough_other = (worst[0], worst[1]) if k > 0 else (math.inf, math.inf)
        progress, clearance, other = road_functions.sweep(road, arc, progress, enough, enough_other)
        _note(found, worst, k, 0, clearance, between)
        _note(found, worst, k, 1, other, between)
        for j in range(radii.shape[0]):
            enough = worst[EDGES + j] + radii[j] if k > 0 else math.inf
            least = sweep(arc, corners, first, j, enough)
            _note(found, worst, k, EDGES + j, least - radii[j], between)
        # Of the time as of the way only the end counts where only the samples do.
        begin, lasting = (0.0, durations[k]) if between else (durations[k], 0.0)
        for j in range(moving.shape[1]):
            radius = moving[k, j, RADIUS] + growth * begin
            u, v = moving[k, j, VELOCITY_X], moving[k, j, VELOCITY_Y]
            there_x, there_y = moving[k, j, X] + begin * u, moving[k, j, Y] + begin * v
            enough = worst[moved + j] + radius if k > 0 else math.inf
            least = sweep_moving(arc, lasting, there_x, there_y, u, v, growth, enough)
            _note(found, worst, k, moved + j, least - radius, between)
    nearest, total = 0, 0.0
    for what in range(worst.shape[0]):
        if worst[what] < worst[nearest]:
            nearest = what
        total += worst[what]
    # Not a number if any of them is not.
    found[2], found[3] = worst[nearest] + 0.0 * total, nearest
    found[7], found[8] = min(worst[0], worst[1]), math.inf
    for what in range(EDGES, worst.shape[0]):
        found[8] = min(found[8], worst[what])


@allocation_free
def _standing(
    moving: Array, j: int, growth: float, x: float, y: float, duration: float, between: bool
) -> float:
    """Clearance from a disc that moves, now or worse, of a robot that stands for a while."""
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
def _note(found: Array, worst: Array, k: int, what: int, clearance: float, between: bool) -> None:
    """Take in the clearance of one step from one thing.

    A robot that is too close already must not get closer. That is what `worst` holds before the
    first step.
    """
    if k == 0:
        allowed = min(worst[what], 0.0) - (0.0 if between else _SAMPLE_TOLERANCE)
        if what == 0 or not clearance >= found[1]:
            found[1] = clearance
        if what == 0 or not allowed - clearance <= found[4]:
            found[4], found[5], found[6] = allowed - clearance, what, clearance
        worst[what] = clearance
    # A number that is not one comes in, and nothing replaces it.
    elif clearance < worst[what] or math.isnan(clearance):
        worst[what] = clearance


def _refused(reason: str) -> Verdict:
    return Verdict(False, reason, -math.inf, -math.inf, 'nothing', -math.inf, -math.inf)
