"""Recovery of a robot that makes no progress: one remedy after the other, until it gives up."""

import itertools
import math
from collections.abc import Callable
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.commands.decision_builder import Step
from cmpsp_ros.guidance.commands.making_way import Checks, Choice
from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.mission.progress_watch import (
    SPACING,
    Remedy,
    tightest,
    way_left,
    why_unreachable,
)
from cmpsp_ros.guidance.mission.return_to_goal import turn_rate
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.planning.retreat import Pace, drive_along
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.validation import TOUCHING, Validation
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.robots import Robot

_BACK: Final = 1.0  # length of the trail that it backs out along [m]
_AHEAD: Final = 1.5  # length of the way on which the place that does not fit is looked for [m]
_NO_MOVES: Final = (
    'The goal is unreachable: no moves to it were found among the obstacles. With a lower '
    'robot.max_wheel_speed or a shorter control_period they need less space.'
)
_BACKS_OUT: Final = 'The robot backs out along the path that it has driven.'
_EDGES: Final = 'The robot edges away from what is near before it backs out.'
_STANDS: Final = 'The robot stands: no short move leads away from what is near.'
_TURNS: Final = 'The robot turns on the spot to look for another way.'
_SAME: Final = 0.5  # distance of places that count as one [m]
_SOONER: Final = 3  # part of the patience, as a divisor, after which the next remedy is tried
_SPEED: Final = 0.3  # speed of a robot that backs out, at most [m/s], and half of its pace
_PURSUED: Final = 0.12  # distance of the point of its trail that it drives to [m]
_EDGE: Final = 0.1  # speed with which it edges away from something [m/s]
_RATES: Final = -0.5, -0.25, 0.0, 0.25, 0.5  # turn rates while edging away [rad/s]
_LASTING: Final = 2.0  # longest move to edge away [s]
_ALIGNED: Final = 0.6  # as of `Pace` [rad]


class Recovery:
    """Chooses the next remedy where the watch has counted no progress for `goal.patience`."""

    def __init__(
        self, settings: LawSettings, checks: Checks, drop_plan: Callable[[LawState], None]
    ) -> None:
        self._settings, self._checks, self._drop_plan = settings, checks, drop_plan
        self._patience = math.ceil(settings.patience / settings.control_period)

    def choose(self, step: Step, *, reached: bool) -> Choice | Decision | None:
        """Count a step, and take the next remedy if it is time; None to go on as planned.

        The first takes the whole patience, each later one a third; on a road they begin again.
        """
        state, start = step.state, step.context.start
        mission, watch = state.mission, state.mission.watch
        follows = mission.goals.goal is None
        if not self._patience or mission.closed_road.obstacles:
            return None
        if watch.begun_at is not None:
            if (choice := self._move(step)) is not None:
                return choice
        else:
            # A road that is followed has no end: every distance driven is progress.
            left = -watch.driven if follows else way_left(self._settings, start, step.context.goal)
            watch.count(start.pose, left, is_excused=reached or state.lateness.halvings > 0)
        allowed = -(-self._patience // (_SOONER if watch.remedy else 1))
        if reached or watch.steps < allowed:
            return None
        watch.steps = 0
        while watch.remedy < (Remedy.TURN if follows else Remedy.GIVE_UP):
            watch.remedy = Remedy(watch.remedy + 1)
            found = self._remedy(step)
            if not isinstance(found, str):
                return found
            if found:
                seconds = allowed * self._settings.control_period
                why = f'There was no progress for {seconds:g} s: {found}'
                return self._checks.decisions.stand(step, why)
        watch.remedy = Remedy.NONE
        return None

    def _remedy(self, step: Step) -> Choice | Decision | str:
        """Begin the remedy that is due: a plan, or a sentence; '' if it cannot be."""
        state, context = step.state, step.context
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
        watch.begin_move(context.start.pose)
        return self._move(step) or ''

    def _block(self, state: LawState, context: PlanningContext) -> str:
        """Make the place ahead that does not fit expensive for the rest of the run."""
        mission, start = state.mission, context.start
        search = start.world.map_search(self._settings)
        if search is None:
            return ''
        line = search.line(start.pose[:2], context.goal.position, SPACING)
        if not len(line):
            return ''
        place, _, name = tightest(self._settings, start, line[: round(_AHEAD / SPACING)])
        known = mission.searched.blocked
        if any(math.dist(place, each) < _SAME for each in known):
            return ''
        mission.searched = mission.searched._replace(blocked=(*known, place), kept=None)
        mission.watch.close(search.detour)
        self._drop_plan(state)
        return f'another way than past {name} at ({place[0]:.2f}, {place[1]:.2f}) is searched.'

    def _move(self, step: Step) -> Choice | Decision | None:
        """Go on backing out or turning; None where that is over, or has not been clear for long."""
        state, context, start = step.state, step.context, step.context.start
        watch, begun = state.mission.watch, state.mission.watch.begun_at
        assert begun is not None  # noqa: S101 (the caller has looked)
        if watch.remedy is Remedy.BACK_OUT:
            is_over = math.dist(start.pose[:2], begun[:2]) >= _BACK or len(watch.trail) < 2
            plan, reason = back_out(context, watch.way_back), _BACKS_OUT
        else:
            watch.turn(float(start.pose[2]))
            is_over = abs(watch.turned) >= math.pi
            plan, reason = turn_round(context), _TURNS
        watch.steps += 1
        if is_over or watch.steps > 2 * self._patience:
            self._end_move(state)
            return None
        verdict = self._check(plan, context)
        ahead = self._checks.approach.contact(plan, start, verdict.worst_margin)
        is_clear = verdict.passed and (ahead is None or ahead.speed > _EDGE)
        if watch.remedy is Remedy.BACK_OUT and not is_clear:
            if (edged := self._edge_away(context)) is not None:
                reason, (plan, verdict) = _EDGES, edged
                ahead = self._checks.approach.contact(plan, start, verdict.worst_margin)
            elif not verdict.passed:
                verdict = verdict._replace(reason=_STANDS)
        if not verdict.passed:
            return self._stand_or_end(step, verdict.reason)
        watch.refused = 0
        return Choice(FallbackLevel.ELASTIC, reason, plan, verdict, ahead, plan)

    def _edge_away(self, context: PlanningContext) -> tuple[Plan, Validation] | None:
        """The slow move that ends farthest from what is near, with its verdict; None if none."""
        checked = ((each, self._check(each, context)) for each in slow_moves(context))
        return next((found for found in checked if found[1].passed), None)

    def _check(self, plan: Plan, context: PlanningContext) -> Validation:
        durations = context.horizon.durations
        return self._checks.validator.check(
            context.start, plan.controls, durations, context.pending
        )

    def _stand_or_end(self, step: Step, reason: str) -> Decision | None:
        """Stand where no move is clear, for a while: noise may have led the robot nearer."""
        watch = step.state.mission.watch
        watch.refused += 1
        if watch.refused > self._patience // _SOONER:
            self._end_move(step.state)
            return None
        return self._checks.decisions.stand(step, reason)

    def _end_move(self, state: LawState) -> None:
        watch = state.mission.watch
        watch.begun_at, watch.steps, watch.refused = None, 0, 0
        self._drop_plan(state)

    def explain_miss(self, state: LawState, start: PlanStart) -> None:
        """Say why the goal was missed, where the robot was stuck or no way leads there."""
        mission = state.mission
        if mission.goals.goal is None or mission.unreachable:
            return
        left = way_left(self._settings, start, mission.goals.target)
        if mission.watch.remedy or math.isinf(left):
            self._explain(state, start)

    def _explain(self, state: LawState, start: PlanStart) -> None:
        """Remember why the goal is unreachable; the last step says it where the width is enough."""
        mission, last = state.mission, '' if state.last is None else state.last[1].reason
        moves = mission.manoeuvres
        has_failed = moves is not None and moves.is_over and not moves.path
        if moves is not None and has_failed and moves.target == mission.goals.target:
            mission.unreachable = _NO_MOVES
            return
        goal, blocked = mission.goals.target.position, mission.searched.blocked
        mission.unreachable = why_unreachable(self._settings, start, goal, blocked, last)


def back_out(context: PlanningContext, trail: Array) -> Plan:
    """Plan back along a trail ``(K, 2)``, the nearest point first [m]."""
    settings = context.settings
    pace = Pace(min(_SPEED, settings.pace / 2.0), turn_rate(settings), _ALIGNED)
    trail = trail if len(trail) else context.start.pose[None, :2]
    return drive_along(context, trail, pace, _PURSUED, _PURSUED)


def turn_round(context: PlanningContext, angle: float = math.pi) -> Plan:
    """Plan of a turn on the spot, to the side of an angle [rad]."""
    robot, controls = context.start.robot, context.zero_controls
    rate = math.copysign(turn_rate(context.settings), angle)
    controls[:-1] = robot.limited(robot.straight_or_turning(0.0, rate, 1.0))
    return context.driven(controls)


def slow_moves(context: PlanningContext) -> list[Plan]:
    """Moves along an arc that end farther from what is near than they begin, the farthest first."""
    start, robot = context.start, context.start.robot
    space, ends = start.world.free_space(context.settings), np.cumsum(context.horizon.durations)
    longest, found = max(int(np.searchsorted(ends, _LASTING)), 1), []
    for twist in _slow_twists(robot):
        controls = context.zero_controls
        controls[:longest] = robot.limited(robot.controls(twist))
        plan = context.driven(controls)
        away = space.at(plan.poses[: longest + 1], start.progress).min(axis=1)
        gains = np.where(np.minimum.accumulate(away) >= min(away[0], 0.0) - TOUCHING, away, -np.inf)
        last = int(gains.argmax())
        if away[last] > away[0] + TOUCHING:
            controls[last:] = 0.0
            found.append((away[last], context.driven(controls)))
    return [plan for _, plan in sorted(found, key=lambda each: -each[0])]


def _slow_twists(robot: Robot) -> list[Array]:
    """Twists with which it edges away: along arcs, or to all sides if it can drive sideways."""
    if robot.drives_sideways:
        ways = np.linspace(0.0, math.tau, 8, endpoint=False).tolist()
        return [_EDGE * np.array([math.cos(each), math.sin(each), 0.0]) for each in ways]
    speeds = (-_EDGE, 0.0, _EDGE) if robot.turns_on_the_spot else (-_EDGE, _EDGE)
    return [np.array(each) for each in itertools.product(speeds, _RATES)]
