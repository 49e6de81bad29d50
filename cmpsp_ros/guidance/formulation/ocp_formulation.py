"""The robot's problem as the settings pose it: costs, penalties, and the space to keep to."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.formulation.constraint_tightening import at_goal, at_samples
from cmpsp_ros.guidance.formulation.guidance_problem import Cost
from cmpsp_ros.guidance.formulation.ocp_functions import EDGES, LINE, POINT, POSE
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.inter_sample_margin import at_ends
from cmpsp_ros.world.obstacles.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]

# Cost of violating a constraint by a metre, in the merit function and in the relaxation. An
# obstacle outranks the road's edge, which outranks the goal.
_OBSTACLE_PENALTY = 1e4
_EDGE_PENALTY = 3e3
_GOAL_PENALTY = 1e3

# Without a wheel limit the arcs between samples are the plan's own, with this much room for the
# plan that comes out of the iterations to be faster or to turn faster.
_ROOM = 1.1


class Task:
    """What every plan for one set of settings is to do.

    Attributes:
        settings: All settings of the guidance law.
        cost: Weights of the cost.
        goal: Point to pass at the end, shape ``(2,)`` [m].
        heading: Heading to pass it with, or direction of the road there; not a number for none
            [rad].
        outputs: What is to be met at the end: a `LINE`, a `POINT` or a `POSE`.
        penalty_terminal: Weight of each of them, shape ``(outputs,)`` [1/m].
        penalty_path: Weight of each path constraint, shape ``(2 + M + S,)`` [1/m]: edges first,
            then obstacles that stand still, then room for as many that move as are listened to.
        heading_trust_region: Largest change of heading in one iteration, infinite for none [rad].
    """

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take road, obstacles and weights from the settings."""
        weights = settings.weights
        self.cost = Cost(weights.road_center, weights.control_change, weights.control_effort)
        self.aim(settings)
        self._capacity = settings.moving_obstacles.room
        obstacles = len(settings.obstacles) + self._capacity
        self.penalty_path = np.array([_EDGE_PENALTY] * EDGES + [_OBSTACLE_PENALTY] * obstacles)
        self.heading_trust_region = settings.solver.heading_trust_region or math.inf
        self._spaces: dict[float, FreeSpace] = {}
        self._padded: tuple[FreeSpace, FreeSpace] | None = None

    def aim(self, settings: GuidanceSettings) -> None:
        """Take another goal; nothing else of the settings may differ."""
        heading = settings.goal_heading
        self.settings = settings
        self.goal = np.array(settings.goal, dtype=float)
        self.heading = math.nan if heading is None else heading
        self.outputs = POINT if heading is None else LINE if settings.follow else POSE
        self.penalty_terminal = np.full(self.outputs, _GOAL_PENALTY)
        self._ends: dict[float, FreeSpace | None] = {}

    def standing(self, guess: Array, durations: Array) -> FreeSpace:
        """Space to keep to at the samples, whatever moves left aside; arguments as of `space`."""
        settings, period = self.settings, self.settings.control_period
        if settings.safety.between_samples and math.isinf(settings.robot.max_wheel_speed):
            twists = _ROOM * settings.robot.twist(guess[:-1])
            longest = max(period, _rounded_up(float(durations.max())))
            return self._standing(period).for_samples_of(twists, longest)
        space = self._standing(period)
        # Late odometry, or a command that takes effect late, makes the first or the last longer.
        first, last = durations.item(0), durations.item(-1)
        for duration in sorted({_rounded_up(each) for each in (first, last) if each > period}):
            arcs = durations > max(period, duration - 0.01)
            space = space.with_some(at_ends(np.logical_or, arcs), self._standing(duration))
        end = self._end(max(period, _rounded_up(last)))
        if end is None:
            return space
        return space.with_some(np.arange(len(durations) + 1) == len(durations), end)

    def _end(self, duration: float) -> FreeSpace | None:
        """What the last sample keeps to instead, after a step so long [s]."""
        if duration not in self._ends:
            self._ends[duration] = at_goal(self.settings, duration)
        return self._ends[duration]

    def _standing(self, longest: float) -> FreeSpace:
        if longest not in self._spaces:
            self._spaces[longest] = at_samples(self.settings, longest)
        return self._spaces[longest]

    def space(
        self,
        guess: Array,
        durations: Array,
        pose: Array | None = None,
        moving: MovingDiscs = NOTHING_MOVES,
    ) -> FreeSpace:
        """Space to keep to at the samples.

        Args:
            guess: Controls that the plan begins with, shape ``(N + 1, 2)`` [rad/s].
            durations: Length of every step, shape ``(N,)`` [s]. Only the first and the last may be
                longer than a control period.
            pose: Where it begins, shape ``(3,)`` [m, m, rad]; may be missing where nothing moves.
            moving: What moves, from then on.
        """
        space = self.standing(guess, durations)
        if self._capacity == 0:
            return space
        if pose is None or not len(moving):
            if self._padded is None or self._padded[0] is not space:
                shape = len(np.atleast_2d(space.radii)), self._capacity
                none = space.with_points(np.zeros((*shape, 2)), np.full(shape, -np.inf))
                self._padded = space, none
            return self._padded[1]
        return space.with_points(*self._slots(guess, durations, pose, moving))

    def _slots(
        self, guess: Array, durations: Array, pose: Array, moving: MovingDiscs
    ) -> tuple[Array, Array]:
        """What the discs that have slots ask for at the samples, each in its own."""
        settings, distance = self.settings, self.settings.robot_radius
        times = np.concatenate([[0.0], np.cumsum(durations)])
        period = max(settings.control_period, _rounded_up(float(durations.max())))
        between, limit = settings.safety.between_samples, settings.robot.max_wheel_speed
        discs = moving.grown(distance + settings.safety.margin)
        if between and math.isinf(limit):
            twists = _ROOM * settings.robot.twist(guess[:-1])
            found = discs.for_samples_of(times, twists, period)
        else:
            limits = settings.robot.twist_limits() if between else None
            found = discs.tightened(times, limits, period, pose)
        centers = np.zeros((len(times), self._capacity, 2))
        radii = np.full((len(times), self._capacity), -np.inf)
        inside = discs.slots >= 0
        centers[:, discs.slots[inside]] = found[0][:, inside]
        radii[:, discs.slots[inside]] = found[1][:, inside]
        return centers, radii


def _rounded_up(duration: float) -> float:
    """To the next centisecond, so that late odometry does not ask for a new space each time."""
    return math.ceil(duration * 100.0 - 1e-6) / 100.0
