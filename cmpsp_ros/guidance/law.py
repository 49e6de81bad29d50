"""The guidance law: one pure object from odometry to decisions."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder
from cmpsp_ros.guidance.commands.final_time import FinalTime
from cmpsp_ros.guidance.commands.late_commands import LateCommands
from cmpsp_ros.guidance.commands.stopping import PATIENCE, closed_ahead, reason_to_stop
from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.horizon import NEVER
from cmpsp_ros.guidance.messages.tracks import MovingObject
from cmpsp_ros.guidance.mission.closed_road import ClosedRoad
from cmpsp_ros.guidance.mission.feasibility_precheck import infeasibility_warnings
from cmpsp_ros.guidance.mission.return_to_goal import return_to_goal
from cmpsp_ros.guidance.planning.grid_path_memory import search_ahead
from cmpsp_ros.guidance.planning.plan_selector import PlanSelector
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.safety.approach import Approach
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.safety.fallback import Fallback
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.guidance.world import NOT_SEARCHED, World
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.roads import arc_length_to


class GuidanceLaw:
    """Predict, find the goal, improve plans, audit, select one, fall back if none may be followed.

    It reads no clock and no file: the same odometry gives the same decisions, bit for bit. What a
    command of now cannot change any more, since it takes effect after `command_delay`, is predicted
    from the commands that the law itself has given.
    """

    def __init__(self, settings: LawSettings, world: World, timer: Callable[[], int] = int) -> None:
        """Start at rest, waiting for the first odometry.

        Args:
            settings: All settings.
            world: Road and static obstacles that are known.
            timer: Monotonic time [ns], for the computing times in decisions; decides nothing.
        """
        self._timer = timer
        self._state = LawState.begin(settings, world, run=0, revision=0)
        self._configure(settings)

    def _configure(self, settings: LawSettings) -> None:
        self._settings = settings
        self._audit = Audit(settings)
        self._fallback = Fallback(settings, self._audit)
        self._approach = Approach(settings, self._audit)
        self._decisions = DecisionBuilder(settings, self._audit)
        self._final_time = FinalTime(settings, self._fallback, self._decisions)
        self._late_commands = LateCommands(settings, self._audit, self._fallback, self._decisions)
        self._selector = PlanSelector(settings, self._state.world, self._audit, self._timer)

    def reset(self) -> None:
        """Begin again: the next odometry is time 0."""
        run, revision = self._state.run + 1, self._state.revision
        known = replace(self._state.world, seen=None, searched=NOT_SEARCHED)
        self._state = LawState.begin(self._settings, known, run, revision)
        self._selector.forget()

    def reconfigure(self, settings: LawSettings, world: World) -> None:
        """Take new settings and another world, from the next control step on."""
        self._state.reconfigure(settings, world)
        self._configure(settings)

    def is_due(self, stamp: int) -> bool:
        """Whether odometry of this time [ns] is one to decide on."""
        state = self._state
        return state.start is None or stamp - state.start >= state.due

    def update(
        self,
        stamp: int,
        pose: Array,
        tracks: tuple[MovingObject, ...] = (),
        sighting: Sighting | None = None,
    ) -> Decision | None:
        """Decide, if a control step is due.

        Args:
            stamp: Time stamp of the odometry [ns].
            pose: Pose ``(x, y, heading)`` [m, m, rad], finite; the heading may be wrapped.
            tracks: Moving obstacles, and trajectories of other robots, as they are known then,
                each once.
            sighting: What is known of the surroundings, where there are sensors.

        Returns:
            The decision, or None between two control steps and for odometry older than the last.
        """
        if not self.is_due(stamp):
            return None
        self._see(sighting)
        if sighting is not None and self._state.start is None:
            # Before time 0 there is time for it.
            self.search(pose)
            self._see(sighting)
        state, settings = self._state, self._settings
        late = state.lateness.begin_step()
        state.start = stamp if state.start is None else state.start
        now = state.now = stamp - state.start
        moving = state.tracker.update(stamp, pose, tracks, settings.moving_obstacles)
        if state.end_period(settings, stamp, pose):
            self._selector.restart()
        here, start, given = state.predict(stamp, pose, moving)
        pending = self._audit.check_pending(here, *given) if len(given[1]) else None
        ramp = state.ramp = self._audit.braking_from(start) if late else state.ramp
        goals = state.goals
        has_new_goal = goals.update(stamp, now, start)
        put_off = self._final_time.put_off(state, start)
        if now >= goals.end:
            return state.sent(self._final_time.finish(state, stamp, pose, moving), tracks)
        state.final_pose = None
        horizon, too_late = self._final_time.horizon(state)
        rest = pending, state.lateness.halvings, state.delay, state.end_speed
        context = PlanningContext(settings, start, goals.target, horizon, state.plan, *rest)
        if too_late:
            decision = self._final_time.go_on(state, stamp, pose, context)
        else:
            context.plan = self._turn(context) if has_new_goal else state.plan or state.waiting
            if late and not has_new_goal and state.plan is not None:
                decision = self._late_commands.follow(state, stamp, pose, context, late)
            else:
                decision = self._decide(stamp, here, context)
        decision = self._late_commands.slowed(state, decision, here, start, ramp)
        decision = decision._replace(reason=put_off + decision.reason)
        self._final_time.decide_in_time(state, start, decision.plan)
        state.step += 1
        state.begin_period(settings, stamp, pose, state.previous_control)
        return state.sent(decision, tracks)

    def _see(self, sighting: Sighting | None) -> None:
        """Take in what has been seen and searched since the last control step."""
        state, known = self._state, self._state.sighting
        is_searched = state.searched is not state.world.searched
        is_known = known is not None and sighting is not None and sighting.stamp == known.stamp
        if sighting is None or (is_known and not is_searched):
            return
        state.sighting = sighting
        if is_searched and state.searched.is_another:
            self._selector.request_replanning()
        state.world = replace(state.world.seeing(sighting.grid), searched=state.searched)

    def search(self, pose: Array) -> None:
        """Search the grid for the paths to the next goals, for the control steps that follow.

        It takes longer than a control step may: the command should be out before. After each
        decision of `update` it is called once, so that a replay does as the run did.

        Args:
            pose: What was decided on, shape ``(3,)`` [m, m, rad].
        """
        state = self._state
        world = replace(state.world, searched=state.searched)
        state.searched = search_ahead(self._settings, world, pose[:2], state.goals.next_positions)

    def foretell(self, decision: Decision, pose: Array) -> Decision:
        """Add to the first decision of a run what no plan of it can do.

        It may take as long as a control step: the command should be out before.

        Args:
            decision: Of `update`.
            pose: What it decided on, shape ``(3,)`` [m, m, rad].
        """
        if decision.step > 0 or decision.finished:
            return decision
        self._state.foretold = tuple(
            infeasibility_warnings(self.task, self.world, (pose[0], pose[1]))
        )
        return decision._replace(reason=' '.join([decision.reason, *self._state.foretold]))

    @property
    def warnings(self) -> list[str]:
        """Tasks that no plan of the run can fulfil, and parameters that odometry contradicts."""
        return [*self._state.foretold, *self._state.response.warnings()]

    @property
    def task(self) -> LawSettings:
        """The settings, with the goal that was received instead of theirs where there is one."""
        received = self._state.goals.received
        return self._settings if received is None else self._settings.towards(received)

    @property
    def world(self) -> World:
        """Road and static obstacles, with what is seen."""
        return self._state.world

    def tell(self, stamp: int, goal: Goal) -> None:
        """Take another goal instead of all others, at the first control step that is not older.

        Args:
            stamp: Its time stamp [ns]; 0 for at once.
            goal: The goal; when to pass it follows from its distance and the nominal speed.

        Raises:
            GoalError: It is refused, and nothing changes.
        """
        state = self._state
        latest = None if state.start is None else state.start + state.now
        state.goals.receive(stamp, goal, state.world, self._audit, latest)

    @property
    def ends_at(self) -> int | None:
        """When the robot is to stop at the latest, a time stamp [ns]; None where none is known."""
        start, end = self._state.start, self._state.goals.end
        return None if start is None or end >= NEVER else start + end

    def distance_to(self, pose: Sequence[float], goal: Goal) -> float:
        """Length of the road from a pose (x, y, heading) [m, m, rad] to a goal [m]."""
        road, progress = self._state.world.road, self._state.progress
        return abs(arc_length_to(road, np.array(pose), goal.position, goal.heading, progress))

    def halt(self, stamp: int, reason: str, **flags: Any) -> Decision:
        """Stop for a reason that odometry does not show.

        The plan is dropped, and the next newer odometry is decided on at once.

        Args:
            stamp: Present time [ns].
            reason: Why, in a sentence.
            flags: Of `Decision`: `finished`, which the next odometry is to judge, `cancelled`, or
                `braking`. With one of them it brakes along the audited path.
        """
        state, nowhere = self._state, np.full(3, math.nan)
        self._drop_plan()
        state.interrupt(is_lost=not any(flags.values()))
        decision = self._decisions.stop(state, stamp, nowhere, reason, halted=True, **flags)
        return state.sent(decision)

    def withdraw(self, decision: Decision, took: float) -> Decision:
        """Take back the last command, which came too late to be sent; its plan goes on.

        Args:
            decision: The last decision, one with a plan.
            took: How long it took [s].

        Returns:
            What to record of it.
        """
        self._state.take_back(took)
        why = f'It took {took:.3g} s and was not sent, for it came too late.'
        return decision._replace(reason=f'{why} {decision.reason}', late=took)

    def _turn(self, context: PlanningContext) -> Plan | None:
        """Begin towards another goal; with a plan where no road says how."""
        self._selector.forget()
        self._state.end_speed = context.end_speed = math.inf
        self._state.idle_steps, self._state.closed_road = 0, ClosedRoad()
        self._state.searched = self._state.searched._replace(hysteresis=NOT_SEARCHED.hysteresis)
        if not self._state.goals.is_return:
            return None
        return return_to_goal(
            self._settings, context.goal, context.start, context.horizon, context.delay
        )

    def _decide(self, stamp: int, here: PlanStart, context: PlanningContext) -> Decision:
        """Select a plan, or fall back: to the previous plan shifted, or to a stop."""
        state, start, pose = self._state, context.start, here.pose
        if state.plan is None and (reason := self._audit.why_no_start(start.world, pose)):
            return self._decisions.stop(state, stamp, pose, reason, moving=start.moving)
        if state.tracker.new_obstacle_seen:
            self._selector.request_replanning()
        state.waiting = None
        waits = '' if len(start.moving) else state.closed_road.waits
        if reason := state.response.reason_to_stop(self._settings) or waits:
            return self._decisions.stop(state, stamp, pose, reason, moving=start.moving)
        selected = self._selector.best(context)
        state.reaches_goal = False
        closed = closed_ahead(state, self._approach, context, selected)
        result, verdict, plan = selected.result, selected.verdict, selected.plan
        errors = selected.terminal_error, selected.heading_error
        if selected.admissible:
            state.failures = 0
            level = FallbackLevel.ELASTIC if selected.is_relaxed else FallbackLevel.NOMINAL
            reason = selected.describe(self._audit, self._settings, start)
            reason += self._selector.remark
            ahead = self._approach.contact(plan, start, verdict.worst_margin)
            if selected.is_relaxed:
                state.end_speed = math.inf
            elif ahead is not None and errors[0] <= self._settings.goal_tolerance:
                state.end_speed = min(state.end_speed, self._approach.end_speed(plan, ahead))
            if why := reason_to_stop(state, context, selected, ahead, closed):
                state.plan, state.waiting = None, plan
                if ahead is not None and start.world.map_search(self._settings) is not None:
                    self._drop_plan()
                    why += ' Another path is searched from here.'
                return self._decisions.stop(state, stamp, pose, f'{why} {reason}', result)
        else:
            state.failures += 1
            reason = verdict.reason if result.solved else result.reason
            shifted = self._fallback.shifted(
                state.plan, start, context.horizon, context.delay, context.pending
            )
            if shifted is None:
                state.idle_steps = PATIENCE
                if closed is not None:
                    reason = f'{state.closed_road.wait_before(closed)} {reason}'
                self._drop_plan_after_failures()
                return self._decisions.stop(state, stamp, pose, reason, result, moving=start.moving)
            level, (plan, verdict) = FallbackLevel.PREVIOUS_PLAN, shifted
            errors = context.goal.errors(plan.poses[-1])
            reason += ' The last audited plan goes on.'
            ahead = self._approach.contact(plan, start, verdict.worst_margin)
        if closed is not None and (ahead is None or closed.speed < ahead.speed):
            ahead = closed
        # It is improved as it is: what slows it down may be wrong about what it leads into.
        state.plan = plan
        self._drop_plan_after_failures()
        limited = self._approach.limited(
            plan, verdict, ahead, start, context.pending, here, state.risk(stamp)
        )
        if limited is None:
            reason = f'The robot stops: no speed is clear of what its response may be. {reason}'
            return self._decisions.stop(state, stamp, pose, reason, result, moving=start.moving)
        plan, verdict, remark = limited
        state.reaches_goal = context.goal.errors(plan.poses[-1])[0] <= self._settings.goal_tolerance
        reason, phases = reason + remark, self._selector.phases
        return self._decisions.follow(
            state, stamp, level, reason, plan, verdict, errors, result, phases
        )

    def _drop_plan(self) -> None:
        self._state.plan = self._state.waiting = None
        self._selector.forget()

    def _drop_plan_after_failures(self) -> None:
        if self._state.failures >= self._settings.failure_tolerance:
            self._drop_plan()
