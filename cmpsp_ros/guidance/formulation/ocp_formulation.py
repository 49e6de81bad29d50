"""The optimal control problem as settings and world pose it: penalties and free space."""

import math
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS, TerminalConstraint
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import World
from cmpsp_ros.mpsp.models import rate_rows
from cmpsp_ros.world import FreeSpace, at_ends
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs

PENALTIES: Final = MappingProxyType({'obstacle': 1e4, 'edge': 3e3, 'terminal_error': 1e3})
"""Cost of violating a constraint by a metre, in the merit function and in elastic mode [1/m].

The heavier outranks the lighter, however little of it is violated. The names are those of
`candidate.Score`. The trajectory check knows no order: no first arc may touch an edge or an
obstacle.
"""

_LATERAL_PENALTY: Final = 1e5
"""Cost of exceeding the lateral acceleration in the merit function, above all of them [s^2/m].

The constraint is curved, so it is soft; a plan slowed down along its path always keeps it.
"""

BY_PRIORITY: Final = tuple(sorted(PENALTIES, key=lambda each: -PENALTIES[each]))
"""Kinds of constraints; the one relaxed last comes first."""

# Without a wheel limit the arcs between samples are the plan's own, with this reserve for a result
# of the iterations that is faster or turns faster.
_RESERVE: Final = 1.1
_FEW_CONTROLS: Final = 2  # with so many, a program without previous controls has code of its own
_MAX_ENDS: Final = 64  # goals whose spaces are remembered


class OcpFormulation:
    """Common part of all plans for one set of settings, and so many obstacles.

    Path constraints of a stage are those of every disc at edges, static obstacles and slots of
    moving ones, then those of wheels, of the lateral acceleration, of jerk and of changes.
    """

    def __init__(self, settings: LawSettings, world: World) -> None:
        """Take weights from the settings, and the number of constraints from the world."""
        self.settings = settings
        self._slots = settings.tracked.slots
        obstacles = len(world.shapes) + self._slots
        # The robot cannot exceed its own limits: they are never relaxed.
        changes = rate_rows(settings.max_wheel_change, settings.robot.rate_limits)
        self.jerk_rows = rate_rows(settings.max_second_difference, settings.robot.wheels)
        # Weight of each path constraint, shape ``(D (2 + M + S) + R,)`` [1/m].
        self.penalty_path = np.array(
            len(settings.footprint.centers)
            * ([PENALTIES['edge']] * N_EDGE_CONSTRAINTS + [PENALTIES['obstacle']] * obstacles)
            + [math.inf] * settings.robot.limit_rows
            + [_LATERAL_PENALTY] * settings.robot.lateral_rows
            + [math.inf] * (self.jerk_rows + changes)
        )
        self.heading_trust_region = settings.solver.heading_trust_region or math.inf
        has_rates = settings.weights.control_rate > 0.0 or changes > 0
        # The previous control is part of the state then; with three controls always, for which code
        # of one size is enough. A jerk limit adds the one before it.
        self.remembers_control = has_rates or settings.robot.n_controls > _FEW_CONTROLS
        # All that the types of a planner's memory and functions depend on; its layout, the memory.
        self.kind = (
            settings.robot,
            settings.solver.qp,
            settings.solver.hessian,
            settings.weights.control_rate,
            settings.max_wheel_change,
            settings.max_second_difference,
            self.heading_trust_region,
        )
        self.layout = self.kind, self.penalty_path.tobytes()
        is_unlimited = math.isinf(settings.robot.max_wheel_speed)
        self._by_guess = settings.safety.between_samples and is_unlimited
        self._use(world)

    def _use(self, world: World) -> None:
        self.world = world
        self._spaces: dict[float, FreeSpace] = {}
        self._ends: dict[tuple[Target, float], FreeSpace | None] = {}
        self._padded: tuple[FreeSpace, FreeSpace] | None = None
        # The last one among moving obstacles: all plans of a step have the same.
        self._among: tuple[tuple[Array, MovingDiscs, Target, Array], FreeSpace] | None = None

    def prepare(self, world: World) -> None:
        """Make the free spaces of a usual step beforehand."""
        if world is not self.world:
            self._use(world)
        self._samples(self.settings.control_period)
        self.world.free_space(self.settings)

    def space(
        self,
        world: World,
        guess: Array,
        durations: Array,
        target: Target,
        pose: Array | None = None,
        moving: MovingDiscs = NOTHING_MOVES,
    ) -> FreeSpace:
        """Free space of the samples of a plan from a guess ``(N + 1, r)``, and from a pose.

        Of the `durations` ``(N,)`` only the first and the last may exceed a control period [s].
        """
        if self._among is not None and world is self.world:
            (begin, known, goal, held), among = self._among
            is_same = begin is pose and known is moving and goal == target
            if is_same and np.array_equal(held, durations):
                return among
        space = self.static_free_space(world, guess, durations, target)
        if self._slots == 0:
            return space
        if pose is None or not len(moving):
            if self._padded is None or self._padded[0] is not space:
                shape = len(np.atleast_2d(space.radii)), self._slots
                none = space.with_points(np.zeros((*shape, 2)), np.full(shape, -np.inf))
                self._padded = space, none
            return self._padded[1]
        space = space.with_points(*self._in_slots(guess, durations, pose, moving))
        if not self._by_guess:
            self._among = (pose, moving, target, durations), space
        return space

    def static_free_space(
        self, world: World, guess: Array, durations: Array, target: Target
    ) -> FreeSpace:
        """Free space of the samples without moving obstacles; arguments as of `space`."""
        if world is not self.world:
            self._use(world)
        period = self.settings.control_period
        if self._by_guess:
            twists = _RESERVE * self._speeds_and_turns(guess)
            longest = max(period, _rounded_up(float(durations.max())))
            return self._samples(period).for_samples_of(twists, longest)
        space = self._samples(period)
        # Late odometry, or a command that takes effect late, makes the first or the last longer.
        first, last = durations.item(0), durations.item(-1)
        if first > period or last > period:
            for duration in sorted({_rounded_up(each) for each in (first, last) if each > period}):
                arcs = durations > max(period, duration - 0.01)
                space = space.with_some(at_ends(np.logical_or, arcs), self._samples(duration))
        if target.is_line or target.drives_on:
            return space
        key = target, max(period, _rounded_up(last))
        if key not in self._ends:
            if len(self._ends) >= _MAX_ENDS:
                self._ends.clear()
            self._ends[key] = goal_space(self.settings, world, target, self._samples(key[1]))
        end = self._ends[key]
        if end is None:
            return space
        return space.with_some(np.arange(len(durations) + 1) == len(durations), end)

    def _samples(self, longest: float) -> FreeSpace:
        if longest not in self._spaces:
            self._spaces[longest] = sample_space(self.settings, self.world, longest)
        return self._spaces[longest]

    def _in_slots(
        self, guess: Array, durations: Array, pose: Array, moving: MovingDiscs
    ) -> tuple[Array, Array]:
        """Centers ``(N + 1, S, 2)`` and radii ``(N + 1, S)`` of moving discs in their slots."""
        settings = self.settings
        times = np.concatenate([[0.0], np.cumsum(durations)])
        period = max(settings.control_period, _rounded_up(float(durations.max())))
        discs = moving.grown(settings.robot_radius + settings.safety.margin)
        if self._by_guess:
            twists = _RESERVE * self._speeds_and_turns(guess)
            found = discs.for_samples_of(times, twists, period)
        else:
            footprint, is_swept = settings.footprint, settings.safety.between_samples
            limits = footprint.twist_limits(settings.robot) if is_swept else None
            found = discs.tightened(times, limits, period, pose, footprint.reach)
        centers = np.zeros((len(times), self._slots, 2))
        radii = np.full((len(times), self._slots), -np.inf)
        inside = discs.slots >= 0
        centers[:, discs.slots[inside]] = found[0][:, inside]
        radii[:, discs.slots[inside]] = found[1][:, inside]
        return centers, radii

    def _speeds_and_turns(self, guess: Array) -> Array:
        settings = self.settings
        return settings.footprint.speeds_and_turns(settings.robot.twist(guess[:-1]))


def path_space(settings: LawSettings, world: World) -> FreeSpace:
    """Free space of every point of the path: robot radius and margin away from everything."""
    return world.free_space(settings, settings.safety.margin)


def sample_space(settings: LawSettings, world: World, longest: float = 0.0) -> FreeSpace:
    """Free space of samples such that the path between them is in `path_space`.

    The longest time between two samples is at least the control period [s].
    """
    period = max(settings.control_period, longest)
    space = path_space(settings, world)
    if settings.safety.between_samples and math.isfinite(settings.robot.max_wheel_speed):
        return space.tightened(settings.footprint.twist_limits(settings.robot), period)
    return space


def goal_space(
    settings: LawSettings, world: World, target: Target, samples: FreeSpace | None = None
) -> FreeSpace | None:
    """Free space of the last sample of a plan, for a goal nearer to something than samples may be.

    The robot is at rest there, so that the distance of `path_space` will do. None for another goal.
    """
    if target.drives_on or target.is_line:
        return None
    heading = math.nan if target.heading is None else target.heading
    goal = np.array([[*target.position, heading]])
    samples = sample_space(settings, world) if samples is None else samples
    path = path_space(settings, world)
    # NaN where a disc is beside the reference point, and the heading may be any.
    near = ~(samples.at(goal)[0] >= 0.0)
    if not near.any() or path.at(goal).min() < 0.0:
        return None
    road: Any = path.road if near[:N_EDGE_CONSTRAINTS].any() else samples.road
    return replace(
        samples, road=road, radii=np.where(near[N_EDGE_CONSTRAINTS:], path.radii, samples.radii)
    )


def terminal_constraint(target: Target) -> TerminalConstraint:
    """Kind of the terminal constraint of a target."""
    if target.heading is None:
        return TerminalConstraint.POINT
    return TerminalConstraint.LINE if target.is_line else TerminalConstraint.POSE


def terminal_penalty(outputs: int) -> Array:
    """Weight of each terminal constraint, shape ``(outputs,)`` [1/m]."""
    return np.full(outputs, PENALTIES['terminal_error'])


def _rounded_up(duration: float) -> float:
    """To the next centisecond, so that late odometry does not need a new space each time."""
    return math.ceil(duration * 100.0 - 1e-6) / 100.0
