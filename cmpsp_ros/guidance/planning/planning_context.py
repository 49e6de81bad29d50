"""The control step that plans are made for, and the initial trajectories for it."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.horizon import shift
from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass
from cmpsp_ros.guidance.planning.homotopy.path_search import (
    GuidePath,
    guide_paths,
    searched_paths,
    turning_first,
)
from cmpsp_ros.guidance.planning.homotopy.road_frame import RoadFrame, road_frame
from cmpsp_ros.guidance.planning.initial_trajectories import along_road, initial_guess
from cmpsp_ros.guidance.planning.manoeuvre_search import timed
from cmpsp_ros.guidance.planning.reeds_shepp import Path, has_to_turn, manoeuvres
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.validation import Validation
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS, Horizon
from cmpsp_ros.guidance.world import World
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.roads import remaining_arc_length

_WORTH_WHILE: Final = 0.05
_FRACTION: Final = 0.1
"""Gain that makes a plan worth driving [m], and its limit as a fraction of the wheels' reach."""
_SOON: Final = NANOSECONDS  # time within which it must gain that: later it may be regained [ns]


@dataclass(frozen=True)
class Encounters:
    """Moving discs at the time and place of the robot's closest approach."""

    names: tuple[str, ...]
    centers: Array  # shape ``(M, 2)`` [m]
    radii: Array  # radii with all that is kept from them, shape ``(M,)`` [m]

    def taken_from(self, space: FreeSpace) -> FreeSpace:
        """A space without them, if there are any, as at one instant."""
        if not self.names:
            return space
        still = space if space.radii.ndim == 1 else replace(space, radii=np.median(space.radii, 0))
        taken = still.with_points(self.centers[None], self.radii[None])
        return replace(taken, radii=taken.radii[0])


_NONE: Final = Encounters((), np.empty((0, 2)), np.empty(0))


@dataclass
class PlanningContext:
    """A control step that plans are made for."""

    settings: LawSettings
    start: PlanStart
    goal: Target
    horizon: Horizon
    plan: Plan | None = None  # the plan followed until now, if any
    pending: Validation | None = None  # validation on the path to the start, if there is one
    halvings: int = 0  # number of times that the work of the step is halved
    delay: int = 0  # time from a command to its effect [ns]
    end_speed: float = math.inf  # largest speed of a car at the end; infinite for none [m/s]
    ends_at_rest: bool = False  # whether the command after the last may be that of rest
    moves: Path = ()  # moves to the goal that have been searched for; empty for none

    @classmethod
    def at_pose(
        cls,
        settings: LawSettings,
        world: World,
        pose: Array,
        horizon: Horizon,
        previous_control: Array | None = None,
    ) -> PlanningContext:
        """From a pose to the goal of the settings, without a plan or pending commands."""
        previous = settings.robot.at_rest if previous_control is None else previous_control
        start = PlanStart(pose, settings.robot, world, previous_control=previous)
        return cls(settings, start, settings.target, horizon)

    @cached_property
    def target(self) -> Target:
        """The goal; without its heading if a single step cannot satisfy both."""
        goal = self.goal
        if len(self.horizon.durations) > 1 or goal.is_line or goal.heading is None:
            return goal
        return goal._replace(heading=None)

    @property
    def at_rest(self) -> bool:
        """True if no plan is followed."""
        return self.plan is None

    @property
    def zero_controls(self) -> Array:
        """Controls of a robot at rest, shape ``(N + 1, r)``."""
        return np.zeros((len(self.horizon.edges), self.start.robot.n_controls))

    def driven(self, controls: Array, horizon: Horizon | None = None) -> Plan:
        """Plan of controls ``(N + 1, r)``, as far as the wheels can follow them."""
        start, horizon = self.start, horizon or self.horizon
        controls = start.followed(self.settings, controls, horizon.durations)
        poses = start.robot.roll_out(start.pose, controls, horizon.durations)
        return Plan(horizon, controls, poses, self.delay)

    @cached_property
    def center_line_guess(self) -> Array:
        """Controls along the centre line, shape ``(N + 1, r)``."""
        return along_road(self.settings, self.start, self.target, self.horizon.durations)

    @cached_property
    def road_frame(self) -> RoadFrame:
        """Road coordinates from the start to the target."""
        return road_frame(self.settings, self.start, self.target)

    @cached_property
    def encounters(self) -> Encounters:
        """Moving discs at their closest approach to the plan, or to the centre line without one."""
        start, settings, moving = self.start, self.settings, self.start.moving
        if not len(moving):
            return _NONE
        durations, plan = self.horizon.durations, self.plan
        controls = (
            self.center_line_guess
            if plan is None
            else shift(plan.controls, plan.horizon, self.horizon)
        )
        poses = settings.robot.roll_out(start.pose, controls, durations)
        centers, radii = moving.at_times(np.concatenate([[0.0], np.cumsum(durations)]))
        away = centers - poses[:, None, :2]
        nearest = np.argmin(np.hypot(away[..., 0], away[..., 1]) - radii, axis=0)
        each = np.arange(len(moving))
        radii = radii[nearest, each] + settings.kept
        return Encounters(moving.names, centers[nearest, each], radii)

    def leads_through(self, controls: Array) -> bool:
        """True if controls ``(N + 1, r)`` lead the middle of the robot through an obstacle."""
        start, durations = self.start, self.horizon.durations
        poses = start.robot.roll_out(start.pose, controls, durations)[:-1]
        space = FreeSpace.of(start.world.road, start.world.shapes, 0.0)
        arcs = poses, start.robot.twist(controls[:-1]), durations
        return bool((space.along(*arcs, start.progress)[:, 2:] < 0.0).any())

    def is_gaining(self, plan: Plan) -> bool:
        """True if a plan soon gets nearer to the goal: along the road, around a map or straight."""
        start, goal, edges = self.start, self.goal, plan.horizon.edges
        soon = max(1, int(edges.searchsorted(edges[0] + _SOON, side='right')) - 1)
        reach = start.robot.max_speed * float(edges[soon] - edges[0]) / NANOSECONDS
        poses = np.ascontiguousarray(plan.poses[: soon + 1])
        along = remaining_arc_length(
            start.world.road, poses, goal.position, goal.heading, start.progress
        )
        lengths = [np.abs(along), np.hypot(*(poses[:, :2] - goal.position).T)]
        search = start.world.map_search(self.settings)
        if search is not None:
            around = search.lengths(poses[:, :2], goal.position)
            lengths = [around] if np.isfinite(around[0]) else lengths
        gain = max(float(each[0] - each.min()) for each in lengths)
        return gain >= min(_WORTH_WHILE, _FRACTION * reach)


class Guesses:
    """Makes at most `limit` initial control histories ``(N + 1, r)``; of one class if that is 1."""

    def __init__(self, formulation: OcpFormulation, limit: int) -> None:
        self._limit, self._formulation = limit, formulation

    def first(self, context: PlanningContext) -> list[Array]:
        """Guesses without any plan: that of the settings, and one for each homotopy class."""
        settings, durations = context.settings, context.horizon.durations
        if context.moves:
            searched = timed(settings, context.start, durations, context.moves)
            if searched is not None:
                return [searched]
        given = initial_guess(settings, context.start, context.target, durations)
        if self._limit == 1:
            return [given]
        if settings.initial_guess.type != 'road':
            return [given, *self.fresh(context, self._limit - 1)]
        turns = has_to_turn(context.start, context.target)
        return (self.turning(context) if turns else []) + self.fresh(context, self._limit)

    def fresh(
        self, context: PlanningContext, limit: int, without: Collection[HomotopyClass] = ()
    ) -> list[Array]:
        """Guesses of the most promising other homotopy classes; else along the centre line.

        A path searched on a grid is first where it leads back, or alone is clear, as in mazes.
        """
        guesses = [each.guess for each in self._paths(context, guide_paths, limit, without)]
        world = context.start.world
        if world.seen is not None:
            searched = self._paths(context, searched_paths)
            guesses[:0] = [each.guess for each in searched if each.backward is not None]
        elif guesses and world.map_search(context.settings) and context.leads_through(guesses[0]):
            searched = self._paths(context, searched_paths)
            clear = [each.guess for each in searched if not context.leads_through(each.guess)]
            guesses[:0] = clear
        return guesses or [context.center_line_guess]

    def turning(self, context: PlanningContext) -> list[Array]:
        """Guesses that begin with a turn on the spot, a searched path too; manoeuvres of a car."""
        settings, start, durations = context.settings, context.start, context.horizon.durations
        if start.robot.drives_sideways:
            return []
        if not start.robot.turns_on_the_spot:
            return manoeuvres(settings, start, context.target, durations)
        paths = self._paths(context, guide_paths, self._limit)
        paths += self._paths(context, searched_paths)
        return [turning_first(settings, path, start, durations) for path in paths]

    def _paths(
        self, context: PlanningContext, find: Callable[..., list[GuidePath]], *arguments: Any
    ) -> list[GuidePath]:
        settings, start, target = context.settings, context.start, context.target
        durations = context.horizon.durations
        if not start.world.shapes and not context.encounters.names:
            return []
        static = self._formulation.static_free_space(
            start.world, context.center_line_guess, durations, target
        )
        space = context.encounters.taken_from(static)
        return find(settings, space, start, target, durations, *arguments)
