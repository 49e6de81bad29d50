"""Remedies for a robot that makes no progress, one after the other, until it stops for good."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder
from cmpsp_ros.guidance.commands.making_way import Choice
from cmpsp_ros.guidance.decision import Decision, FallbackLevel
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.mission.back_out import back_out, turn_round
from cmpsp_ros.guidance.mission.progress_watch import Remedy
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import Observation, PlanStart
from cmpsp_ros.guidance.safety.approach import Approach
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.world.roads import remaining_arc_length

_BACK: Final = 1.0
"""Length of the trail that it backs out along [m]."""
_AHEAD: Final = 1.5
"""Length of the way ahead on which the place that does not fit is looked for [m]."""
_SPACING: Final = 0.05
_SAME: Final = 0.5
"""Distance of places that count as one [m]."""


class Escalation:
    """Chooses the next remedy where the watch has counted no progress for `goal.patience`."""

    def __init__(
        self,
        settings: LawSettings,
        validator: Validator,
        approach: Approach,
        decisions: DecisionBuilder,
        drop_plan: Callable[[LawState], None],
    ) -> None:
        """Take what checks plans, what decides on them, and how to search all classes afresh."""
        self._settings, self._validator, self._approach = settings, validator, approach
        self._decisions, self._drop_plan = decisions, drop_plan
        self._patience = math.ceil(settings.patience / settings.control_period)

    def choose(
        self, state: LawState, seen: Observation, context: PlanningContext, *, reached: bool
    ) -> Choice | Decision | None:
        """Count a step, and take the next remedy if it is time; None to go on as planned.

        Steps whose last plan reached the goal do not count, nor those before a closed road.
        """
        mission, start = state.mission, context.start
        watch, goals = mission.watch, mission.goals
        if not self._patience or goals.goal is None or mission.closed_road.obstacles:
            return None
        if watch.begun_at is not None:
            if (choice := self._move(state, context)) is not None:
                return choice
        elif reached:
            watch.reset()
            return None
        else:
            watch.count(start.pose, self._way_left(start, context.goal))
        if watch.steps < self._patience:
            return None
        watch.steps = 0
        while watch.remedy < Remedy.GIVE_UP:
            watch.remedy = Remedy(watch.remedy + 1)
            found = self._remedy(state, context)
            if isinstance(found, Choice):
                return found
            if found:
                seconds = self._settings.patience
                why = f'There was no progress for {seconds:g} s: {found}'
                return self._decisions.stop(state, seen.stamp, seen.pose, why, moving=start.moving)
        return None

    def _remedy(self, state: LawState, context: PlanningContext) -> Choice | str:
        """Begin the remedy that is due: a plan, or a sentence; '' if it cannot be."""
        mission, watch = state.mission, state.mission.watch
        if watch.remedy is Remedy.OTHER_CLASS:
            self._drop_plan(state)
            return 'all homotopy classes are searched from here.'
        if watch.remedy is Remedy.OTHER_WAY:
            return self._block(state, context)
        if watch.remedy is Remedy.GIVE_UP:
            self._explain(state, context.start)
            mission.goals.give_up(state.clock.now)
            self._drop_plan(state)
            return mission.unreachable
        if watch.remedy is Remedy.TURN and not context.start.robot.turns_on_the_spot:
            return ''
        watch.begun_at = context.start.pose
        return self._move(state, context) or ''

    def _block(self, state: LawState, context: PlanningContext) -> str:
        """Make the place ahead that does not fit expensive for the rest of the run."""
        mission, start = state.mission, context.start
        search = start.world.map_search(self._settings)
        if search is None:
            return ''
        line = search.line(start.pose[:2], context.goal.position, _SPACING)
        if not len(line):
            return ''
        place, _, name = self._tightest(start, line[: round(_AHEAD / _SPACING)])
        known = mission.searched.blocked
        if any(math.dist(place, each) < _SAME for each in known):
            return ''
        mission.searched = mission.searched._replace(blocked=(*known, place), kept=None)
        mission.watch.nearest = math.inf
        self._drop_plan(state)
        return f'another way than past {name} at ({place[0]:.2f}, {place[1]:.2f}) is searched.'

    def _move(self, state: LawState, context: PlanningContext) -> Choice | None:
        """Go on backing out or turning; None where that is over, or not clear."""
        watch, start, settings = state.mission.watch, context.start, self._settings
        begun = watch.begun_at
        assert begun is not None  # noqa: S101 (the caller has looked)
        if watch.remedy is Remedy.BACK_OUT:
            is_over = math.dist(start.pose[:2], begun[:2]) >= _BACK or len(watch.trail) < 2
            plan = back_out(settings, start, context.horizon, context.delay, watch.way_back)
            reason = 'The robot backs out along the path that it has driven.'
        else:
            is_over = abs(start.pose[2] - begun[2]) >= math.pi
            plan = turn_round(settings, start, context.horizon, context.delay)
            reason = 'The robot turns on the spot to look for another way.'
        verdict = self._validator.check(
            start, plan.controls, context.horizon.durations, context.pending
        )
        watch.steps += 1
        if is_over or not verdict.passed or watch.steps > 2 * self._patience:
            watch.begun_at, watch.steps = None, 0
            self._drop_plan(state)
            return None
        ahead = self._approach.contact(plan, start, verdict.worst_margin)
        return Choice(FallbackLevel.ELASTIC, reason, plan, verdict, ahead, plan)

    def _way_left(self, start: PlanStart, goal: Target) -> float:
        """Length of the way to the goal; infinite where none is known [m]."""
        if (search := start.world.map_search(self._settings)) is not None:
            return float(search.lengths(start.pose[None, :2], goal.position)[0])
        along = remaining_arc_length(
            start.world.road, start.pose[None], goal.position, goal.heading, start.progress
        )
        return abs(float(along[0]))

    def _tightest(self, start: PlanStart, line: Array) -> tuple[tuple[float, float], float, str]:
        """Place of least clearance on a line (x, y) [m], that clearance [m], and beside what."""
        space, poses = start.world.free_space(self._settings), np.zeros((len(line), 3))
        poses[:, :2] = line
        away = space.at(poses)
        k, j = np.unravel_index(int(away.argmin()), away.shape)
        return (float(line[k, 0]), float(line[k, 1])), float(away[k, j]), start.world.names[j]

    def explain_miss(self, state: LawState, start: PlanStart) -> None:
        """Say why the goal was missed, where the robot was stuck or no way leads there."""
        mission = state.mission
        if mission.goals.goal is None or mission.unreachable:
            return
        if mission.watch.remedy or math.isinf(self._way_left(start, mission.goals.target)):
            self._explain(state, start)

    def _explain(self, state: LawState, start: PlanStart) -> None:
        """Remember a sentence that names what closes which way."""
        goal = state.mission.goals.target.position
        search, places = start.world.map_search(self._settings), [start.pose[None, :2]]
        if search is not None:
            line = search.line(start.pose[:2], goal, _SPACING)
            places = [np.array([each]) for each in state.mission.searched.blocked] or [line]
            if not len(line):
                # The way of a point shows what is too narrow for the body.
                point = replace(search, wanted=0.0, margin=0.0, body=0.0)
                line = point.line(start.pose[:2], goal, _SPACING)
                places = [line if len(line) else np.array([goal])]
        body, parts, fits = self._settings.robot_radius, [], True
        for each in places:
            (x, y), clear, name = self._tightest(start, each)
            beside, fits = max(clear + body, 0.0), fits and clear >= 0.0
            parts.append(f'past {name} at ({x:.2f}, {y:.2f}), which leaves {beside:.3f} m')
        margin = self._settings.safety.margin
        state.mission.unreachable = (
            f'The goal is unreachable: no plan gets {", nor ".join(parts)} beside the path; the'
            f' robot needs {body:.3f} m, and {margin:.3f} m of margin.'
        )
        if fits and state.last is not None:
            # The width is not the cause: the last step says what is.
            state.mission.unreachable += f' {state.last[1].reason}'
