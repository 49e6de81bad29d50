"""The optimal control problem of a step as the settings pose it: weights, penalties, free space."""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation.constraint_tightening import goal_space, sample_space
from cmpsp_ros.guidance.formulation.guidance_problem import Cost
from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS, TerminalConstraint
from cmpsp_ros.guidance.formulation.priorities import PENALTIES
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import World
from cmpsp_ros.mpsp.models import rate_rows
from cmpsp_ros.world import FreeSpace, at_ends
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs

# Without a wheel limit the arcs between samples are the plan's own, with this reserve for a result
# of the iterations that is faster or turns faster.
_RESERVE = 1.1

# Goals are few at a time; those of a long run are not all remembered.
_MAX_ENDS = 64


class OcpFormulation:
    """What every plan for one set of settings, and so many obstacles, has in common.

    Attributes:
        settings: All settings of the guidance law.
        world: Road and static obstacles that it was asked about last.
        cost: Weights of the cost.
        penalty_path: Weight of each path constraint, shape ``(D (2 + M + S) + R,)`` [1/m]: of every
            disc edges first, then static obstacles and the slots of moving ones; limits of wheels.
        heading_trust_region: Largest change of heading in one iteration, infinite for none [rad].
        remembers_control: Whether the previous control is part of the state: it has a cost, or a
            limit.
    """

    def __init__(self, settings: LawSettings, world: World) -> None:
        """Take weights from the settings, and the number of constraints from the world."""
        self.settings = settings
        weights = settings.weights
        self.cost = Cost(weights.road_center, weights.control_change, weights.control_effort)
        self._slots = settings.moving_obstacles.slots
        obstacles = len(world.shapes) + self._slots
        # What exceeds its limits the robot cannot do: that is never relaxed.
        changes = rate_rows(settings.max_wheel_change, settings.robot.rate_limits)
        self.penalty_path = np.array(
            len(settings.footprint.centers)
            * ([PENALTIES['edge']] * N_EDGE_CONSTRAINTS + [PENALTIES['obstacle']] * obstacles)
            + [math.inf] * (settings.robot.limit_rows + changes)
        )
        self.heading_trust_region = settings.solver.heading_trust_region or math.inf
        self.remembers_control = weights.control_rate > 0.0 or changes > 0
        self._by_guess = settings.safety.between_samples and math.isinf(
            settings.robot.max_wheel_speed
        )
        self._take(world)

    def _take(self, world: World) -> None:
        self.world = world
        self._spaces: dict[float, FreeSpace] = {}
        self._ends: dict[tuple[Target, float], FreeSpace | None] = {}
        self._padded: tuple[FreeSpace, FreeSpace] | None = None

    def static_free_space(
        self, world: World, guess: Array, durations: Array, target: Target
    ) -> FreeSpace:
        """Space to keep to at the samples without moving obstacles; arguments as of `space`."""
        if world is not self.world:
            self._take(world)
        period = self.settings.control_period
        if self._by_guess:
            twists = _RESERVE * self._speeds_and_turns(guess)
            longest = max(period, _rounded_up(float(durations.max())))
            return self._static(period).for_samples_of(twists, longest)
        space = self._static(period)
        # Late odometry, or a command that takes effect late, makes the first or the last longer.
        first, last = durations.item(0), durations.item(-1)
        if first > period or last > period:
            for duration in sorted({_rounded_up(each) for each in (first, last) if each > period}):
                arcs = durations > max(period, duration - 0.01)
                space = space.with_some(at_ends(np.logical_or, arcs), self._static(duration))
        end = self._end(target, max(period, _rounded_up(last)))
        if end is None:
            return space
        return space.with_some(np.arange(len(durations) + 1) == len(durations), end)

    def _end(self, target: Target, duration: float) -> FreeSpace | None:
        """What the last sample keeps to instead, after a step so long [s]."""
        if target.is_line or target.drives_on:
            return None
        key = target, duration
        if key not in self._ends:
            if len(self._ends) >= _MAX_ENDS:
                self._ends.clear()
            self._ends[key] = goal_space(self.settings, self.world, target, duration)
        return self._ends[key]

    def _static(self, longest: float) -> FreeSpace:
        if longest not in self._spaces:
            self._spaces[longest] = sample_space(self.settings, self.world, longest)
        return self._spaces[longest]

    def space(
        self,
        world: World,
        guess: Array,
        durations: Array,
        target: Target,
        pose: Array | None = None,
        moving: MovingDiscs = NOTHING_MOVES,
    ) -> FreeSpace:
        """Space to keep to at the samples.

        Args:
            world: Road and static obstacles, as many as the formulation was made for.
            guess: Controls that the plan begins with, shape ``(N + 1, r)``.
            durations: Length of every step, shape ``(N,)`` [s]. Only the first and the last may be
                longer than a control period.
            target: What is to be met at the end.
            pose: Where it begins, shape ``(3,)`` [m, m, rad]; needed for moving obstacles only.
            moving: Moving obstacles, from then on.
        """
        space = self.static_free_space(world, guess, durations, target)
        if self._slots == 0:
            return space
        if pose is None or not len(moving):
            if self._padded is None or self._padded[0] is not space:
                shape = len(np.atleast_2d(space.radii)), self._slots
                none = space.with_points(np.zeros((*shape, 2)), np.full(shape, -np.inf))
                self._padded = space, none
            return self._padded[1]
        return space.with_points(*self._in_slots(guess, durations, pose, moving))

    def _in_slots(
        self, guess: Array, durations: Array, pose: Array, moving: MovingDiscs
    ) -> tuple[Array, Array]:
        """What the moving discs that have slots ask for at the samples, each in its own."""
        settings, distance = self.settings, self.settings.robot_radius
        times = np.concatenate([[0.0], np.cumsum(durations)])
        period = max(settings.control_period, _rounded_up(float(durations.max())))
        discs = moving.grown(distance + settings.safety.margin)
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


def terminal_constraint(target: Target) -> TerminalConstraint:
    """What is to be met at the end."""
    if target.heading is None:
        return TerminalConstraint.POINT
    return TerminalConstraint.LINE if target.is_line else TerminalConstraint.POSE


def terminal_penalty(outputs: int) -> Array:
    """Weight of each terminal constraint, shape ``(outputs,)`` [1/m]."""
    return np.full(outputs, PENALTIES['terminal_error'])


def _rounded_up(duration: float) -> float:
    """To the next centisecond, so that late odometry does not ask for a new space each time."""
    return math.ceil(duration * 100.0 - 1e-6) / 100.0
