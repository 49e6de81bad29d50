"""The check before any command leaves, which does not trust the solver's result."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import reduce
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.prediction.response import Response, driven
from cmpsp_ros.guidance.safety.plan_sweep import SWEEP, PlanSweep, sweep_plan
from cmpsp_ros.guidance.safety.reach_check import ReachCheck
from cmpsp_ros.guidance.safety.road_braking import brakings_on_road
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.guidance.world import SEEN, World
from cmpsp_ros.mpsp.jit import entry_for
from cmpsp_ros.robots import placed
from cmpsp_ros.robots.motion import NO_RAMP, braking
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs
from cmpsp_ros.world.roads import OpenFloor

TOUCHING: Final = 1e-3  # penetration that is said to touch [m]: odometry errs by more

_NO_LEGS: Final = NOTHING_MOVES.legs(np.empty(0))

# A command that was good when it was given is checked again from odometry that has been rounded.
_ROUNDING = 1e-6
_SEEN: Final = f'obstacle {SEEN}'
_TO_REST: Final = 4.0  # time constants for which a lagging wheel is watched after the last command
CHANGE_ROUNDING: Final = 1e-6  # excess over a limit that a solver may leave [rad/s]


class Validation(NamedTuple):
    """Outcome of a trajectory check."""

    passed: bool  # true if the first command may be sent
    reason: str  # reason of a failure; '' when passed
    margin: float  # minimum clearance over the first control period [m]
    worst_margin: float  # minimum clearance over the whole plan [m]
    nearest: str  # name of the obstacle nearest to the whole plan
    edge_margin: float  # minimum clearance of the whole plan from the road's edges [m]
    obstacle_margin: float  # the same from obstacles, moving ones too; infinite without any [m]
    ramp: Array = NO_RAMP  # commands ``(K, r)`` to stop after the first; none to stop at once

    def followed_by(self, later: Validation) -> Validation:
        """The verdict on this path and the one that follows, of which the margins are."""
        first = self if not self.passed or later.passed else later
        nearer = self if self.worst_margin < later.worst_margin else later
        return Validation(
            self.passed and later.passed,
            first.reason,
            min(self.margin, later.margin),
            nearer.worst_margin,
            nearer.nearest,
            later.edge_margin,
            later.obstacle_margin,
            later.ramp,
        )


class Validator:
    """Checks plans: finite, within the wheel limits, clear for the first control period.

    With a limit of acceleration it is also clear to rest along plan, curvature or road.
    """

    def __init__(self, settings: LawSettings, margin: float = 0.0, sweep: Any = None) -> None:
        self._settings, self._margin = settings, margin
        self._radius = settings.robot_radius + margin
        self._between = settings.safety.between_samples
        self._slots = settings.tracked.slots
        self._has_limits = bool(settings.robot.steering_limits or settings.robot.lateral_rows)
        self._known: tuple[World, FreeSpace] | None = None
        self._period, self._max_change = settings.control_period, settings.max_wheel_change
        self._reach = ReachCheck(settings, self._radius)
        self._found, self._scratch = np.zeros(1, SWEEP), np.empty((2, N_EDGE_CONSTRAINTS))
        start = PlanStart(np.zeros(3), settings.robot, World(OpenFloor()))
        rest = np.zeros((2, settings.robot.n_controls))
        self._sweep = sweep or entry_for(sweep_plan, *self._arguments(start, rest, np.ones(1)))

    def with_margin(self, margin: float) -> Validator:
        """The same checks for a robot with a margin [m] around it."""
        return Validator(self._settings, margin, self._sweep)

    def _space(self, world: World) -> FreeSpace:
        """Free space of a world, which is mostly that of the last question."""
        if self._known is None or self._known[0] is not world:
            self._known = world, world.free_space(self._settings, self._margin)
        return self._known[1]

    def check(
        self, start: PlanStart, controls: Array, durations: Array, pending: Validation | None = None
    ) -> Validation:
        """Roll out a plan ``(N + 1, r)`` and check whether its first command may be sent.

        A robot outside the road or inside an obstacle may not get deeper; no moving obstacle may
        reach it before it is at rest.
        """
        verdict = self._check(start, controls, durations)
        return verdict if pending is None else pending.followed_by(verdict)

    def _check(self, start: PlanStart, controls: Array, durations: Array) -> Validation:
        limit = start.robot.max_wheel_speed
        found = self._swept(start, controls, durations)
        if not math.isfinite(found.fastest):
            return _refused('The plan has a wheel speed that is not a finite number.')
        if found.fastest > limit:
            return _refused(
                f'The plan has a wheel speed of {found.fastest!r} rad/s, the limit is {limit!r}'
                ' rad/s.'
            )
        if self._has_limits and (over := start.robot.over_limit(controls)):
            return _refused(over)
        if not (math.isfinite(found.committed) and math.isfinite(found.worst)):
            return _refused('The path of the plan is not finite.')
        reason, ramp = '', NO_RAMP
        if found.shortfall > 0.0:
            close = f'{-found.tightest:.3g} m too close to {_name_of(found.short_of, start)}'
            reason = f'The next {durations[0]:.3g} s would come {close}.'
        elif self._max_change < math.inf:
            reason, ramp = self._ramp(start, controls, durations)
        elif start.reachable.names:
            reason = self._reach.reason(start, controls[:1], durations[:1])
        name, edges = _name_of(found.nearest, start), found.edges
        margins = found.committed, found.worst
        return Validation(not reason, reason, *margins, name, edges, found.others, ramp)

    def _ramp(self, start: PlanStart, controls: Array, durations: Array) -> tuple[str, Array]:
        """Reason not to send the first command, '' if none, and commands to stop after it."""
        reason = reason_not_to_change(self._settings, start, controls[: len(durations)])
        if reason:
            return reason, NO_RAMP
        still = start._replace(moving=NOTHING_MOVES)
        for ramp in self._ramps(start, controls, durations):
            held = np.array([durations[0], *[self._period] * len(ramp)])
            path = np.vstack([controls[:1], ramp])
            found = self._swept(still, path, held, len(held))
            if found.shortfall > _ROUNDING:
                into = f'{-found.tightest:.3g} m into {_name_of(found.short_of, start)}'
                reason = f'To stop after the next {held[0]:.3g} s leads {into}.'
            else:
                reason = self._reach.reason(start, path, held)
                if not reason:
                    return '', ramp
        return reason, NO_RAMP

    def _ramps(self, start: PlanStart, controls: Array, durations: Array) -> Iterator[Array]:
        """Commands that stop it along the plan, along its curvature, and along the road."""
        limits = self._period, self._max_change
        for along in (True, False):
            yield braking(controls, durations, *limits, start.robot.time_scaling, along=along)
        if start.world.road.has_center_line:
            held = durations.item(0)
            yield from brakings_on_road(start, controls[0], held, *limits)

    def braking_from(self, start: PlanStart) -> Array:
        """Commands ``(K, r)`` to rest along the present curvature; none if they are not clear."""
        if self._max_change == math.inf:
            return NO_RAMP
        held = np.stack([start.previous_control, start.previous_control])
        period, paced = np.array([self._period]), start.robot.time_scaling
        ramp = braking(held, period, self._period, self._max_change, paced, along=False)
        durations = np.full(len(ramp), self._period)
        shortfall = self._swept(start, ramp, durations, len(ramp)).shortfall
        is_clear = shortfall <= _ROUNDING and not self._reach.reason(start, ramp, durations)
        return ramp if is_clear else NO_RAMP

    def is_clear_with(
        self, response: Response, here: PlanStart, plan: Plan, ramp: Array, error: float
    ) -> bool:
        """True if a robot with this response stays clear under a plan's first command and a stop.

        The clearance required is `error` [m], or that at rest; `ramp` ``(K, r)`` is the stop.
        """
        ramp = ramp.reshape(-1, plan.controls.shape[1])
        last = here.robot.stopped(np.vstack([plan.controls[:1], ramp])[-1])
        commands = np.vstack([response.pending, plan.controls[:1], ramp, last])
        # A plan that begins ahead of the robot may end before its first command does.
        first = min(plan.horizon.durations.item(0) + plan.delay / NANOSECONDS, self._period)
        held = [first, *[self._period] * len(ramp), _TO_REST * response.lag]
        durations = np.append(response.durations, held)
        lasting = durations > 0.0
        effective = response.effective.copy()
        path = driven(effective, commands[lasting], durations[lasting], response.lag)
        found = self._swept(here, *path, len(path[1]))
        if found.shortfall > _ROUNDING or self._reach.reason(here, *path):
            return False
        if found.committed < error:
            error = (
                self._swept(here, commands[-1:], durations.sum(keepdims=True)).committed - _ROUNDING
            )
        return found.committed >= error

    def check_pending(self, start: PlanStart, controls: Array, durations: Array) -> Validation:
        """Verdict on the path along which commands given before lead ``(K, r)``, ``(K,)`` [s]."""
        poses = start.robot.roll_out(start.pose, controls, durations)
        begins = np.cumsum(durations) - durations
        arcs = []
        for k, begin in enumerate(begins.tolist()):
            at = start._replace(pose=poses[k], moving=start.moving.after(begin))
            arcs.append(self._check_arc(at, controls[k : k + 1], durations[k : k + 1]))
        verdict = reduce(Validation.followed_by, arcs)
        reason = self._reach.reason(start, controls, durations) if verdict.passed else ''
        return verdict._replace(passed=False, reason=reason) if reason else verdict

    def _check_arc(self, start: PlanStart, controls: Array, duration: Array) -> Validation:
        found = self._swept(start, controls, duration)
        if not math.isfinite(found.committed):
            return _refused('The way under the commands given before is not finite.')
        reason = ''
        if found.shortfall > _ROUNDING:
            close = f'{-found.tightest:.3g} m too close to {_name_of(found.short_of, start)}'
            reason = f'The commands given before come {close}.'
        name = _name_of(found.nearest, start)
        margin = found.committed
        return Validation(not reason, reason, margin, margin, name, found.edges, found.others)

    def _swept(
        self, start: PlanStart, controls: Array, durations: Array, committed: int = 1
    ) -> PlanSweep:
        self._sweep(*self._arguments(start, controls, durations, committed))
        return PlanSweep(*self._found[0].item())

    def _arguments(
        self, start: PlanStart, controls: Array, durations: Array, committed: int = 1
    ) -> tuple[Any, ...]:
        """Arguments of `sweep_plan`, each always of the same type."""
        pose, robot, world, moving, progress, *_ = start
        legs = moving.grown(self._radius).legs(durations) if moving.names else _NO_LEGS
        things = len(world.names) + len(moving.names)
        if self._scratch.shape[1] != things:
            self._scratch = np.empty((2, things))
        return (
            self._found,
            self._scratch,
            np.ascontiguousarray(pose, np.float64),
            np.ascontiguousarray(controls, np.float64),
            np.ascontiguousarray(durations, np.float64),
            robot.kinematics,
            committed,
            self._between,
            self._space(world).data,
            legs,
            float(progress),
        )

    def clearance_at(
        self,
        world: World,
        pose: Array,
        moving: MovingDiscs = NOTHING_MOVES,
        progress: float = math.nan,
    ) -> Array:
        """Clearance of a pose from road edges, obstacles, moving ones last ``(2 + M + D,)`` [m]."""
        space = self._space(world)
        static = space.at(pose[None], progress)[0]
        if not moving.names:
            return np.asarray(static)
        away = moving.clearance(placed(space.discs, pose)).min(axis=0)
        return np.concatenate([static, away - self._radius])

    def why_no_start(self, world: World, pose: Array) -> str:
        """Reason not to start at a pose ``(3,)`` [m, m, rad]: it is inside an obstacle; '' if none.

        A moving robot is led out instead. Seen cells reach beyond the obstacle, and do not count.
        """
        away, names = self.clearance_at(world, pose), world.names
        counts = range(N_EDGE_CONSTRAINTS, len(names))
        nearest = min((k for k in counts if names[k] != _SEEN), key=away.item, default=None)
        if nearest is None or not away[nearest] < -TOUCHING:
            return ''
        return (
            f'The robot is {-away[nearest]:.3g} m inside {names[nearest]}: nothing is begun there.'
        )

    def names(
        self, constraints: Sequence[int], world: World, moving: MovingDiscs = NOTHING_MOVES
    ) -> str:
        """Names of path constraints by their index, for messages."""
        known, slots = len(world.names), moving.slots.tolist()
        # Every disc of the robot has the same ones.
        rows = len(self._settings.footprint.centers) * (known + self._slots)
        things = dict.fromkeys(i % (known + self._slots) for i in constraints if i < rows)
        places = [i if i < known else known + slots.index(i - known) for i in things]
        names = (*world.names, *moving.names)
        lateral = ['the lateral acceleration'] if max(constraints, default=0) >= rows else []
        return ', '.join([*(names[index] for index in places), *lateral])


def _name_of(number: float, start: PlanStart) -> str:
    """Name of the edge, obstacle or moving disc of that number; see `PlanSweep`."""
    names = (*start.world.names, *start.moving.names)
    return names[int(number)]


def _refused(reason: str) -> Validation:
    return Validation(False, reason, -math.inf, -math.inf, 'nothing', -math.inf, -math.inf)


def reason_not_to_change(settings: LawSettings, start: PlanStart, controls: Array) -> str:
    """Reason not to send the first of controls ``(K, r)``, by acceleration or jerk; else ''."""
    commands, robot = np.vstack([start.previous_control, controls]), start.robot
    limit = settings.max_wheel_change
    change = float(np.abs((commands[1:] - commands[:-1]) @ robot.rate_limits.T).max())
    if not change <= limit + CHANGE_ROUNDING:
        return (
            f'The plan changes a wheel by {change!r} rad/s from one command to the next, the'
            f' limit is {limit!r} rad/s.'
        )
    if (limit := settings.max_second_difference) == math.inf:
        return ''
    second = controls[0] - start.previous_control - start.previous_change
    change = float(np.abs(robot.wheels @ second).max())
    if change <= limit + CHANGE_ROUNDING:
        return ''
    return (
        f'The plan changes the acceleration of a wheel by {change!r} rad/s per control period, the'
        f' limit is {limit!r} rad/s.'
    )
