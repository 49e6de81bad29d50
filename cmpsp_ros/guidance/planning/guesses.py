"""Guesses for plans that do not continue another one."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass
from cmpsp_ros.guidance.planning.homotopy.path_search import (
    GuidePath,
    guide_paths,
    searched_paths,
    turning_first,
)
from cmpsp_ros.guidance.planning.initial_trajectories import initial_guess
from cmpsp_ros.guidance.planning.manoeuvres import has_to_turn, manoeuvres
from cmpsp_ros.guidance.planning.planning_context import PlanningContext


class Guesses:
    """Makes control histories, each of shape ``(N + 1, r)``."""

    def __init__(self, formulation: OcpFormulation, limit: int) -> None:
        """Take the problem.

        Args:
            formulation: What all plans have in common.
            limit: How many plans are compared; with one, no homotopy classes are searched for.
        """
        self._limit, self._formulation = limit, formulation

    def first(self, context: PlanningContext) -> list[Array]:
        """Without any plan: as the settings say, and one for each homotopy class."""
        settings = context.settings
        given = initial_guess(settings, context.start, context.target, context.horizon.durations)
        if self._limit == 1:
            return [given]
        if settings.initial_guess.type == 'road':
            turning = []
            if has_to_turn(context.start, context.target):
                turning = self.turning(context)
            return turning + self.fresh(context, self._limit)
        return [given, *self.fresh(context, self._limit - 1)]

    def fresh(
        self, context: PlanningContext, limit: int, without: Collection[HomotopyClass] = ()
    ) -> list[Array]:
        """Of the most promising homotopy classes; along the centre line if there is but one.

        Args:
            context: What they are for.
            limit: How many at most.
            without: Classes that are not wanted.
        """
        paths = self._paths(context, guide_paths, limit, without)
        return [path.guess for path in paths] or [context.center_line_guess]

    def turning(self, context: PlanningContext) -> list[Array]:
        """Of the most promising homotopy classes, but each begins with a turn on the spot.

        A searched path is among them: a way may lead on where a robot could not follow it. One that
        drives sideways needs none, and a car turns back and forth instead.
        """
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
        settings, target, durations = context.settings, context.target, context.horizon.durations
        if not context.start.world.shapes and not context.encounters.names:
            return []
        static = self._formulation.static_free_space(
            context.start.world, context.center_line_guess, durations, target
        )
        space = context.encounters.taken_from(static)
        return find(settings, space, context.start, target, durations, *arguments)
