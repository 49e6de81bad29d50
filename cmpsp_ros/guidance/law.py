"""The guidance law: one pure object from observations to decisions."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.guidance.commands.decision_builder import Step
from cmpsp_ros.guidance.commands.supervisor import Supervisor
from cmpsp_ros.guidance.decision import Decision
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.horizon import remaining
from cmpsp_ros.guidance.mission.feasibility import infeasibility_warnings
from cmpsp_ros.guidance.mission.progress_watch import Remedy
from cmpsp_ros.guidance.mission.return_to_goal import return_to_goal
from cmpsp_ros.guidance.plan_ahead import PlanAhead
from cmpsp_ros.guidance.planning.grid_path_memory import search_ahead
from cmpsp_ros.guidance.planning.plan_selector import PlanSelector
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import Estimate, Observation
from cmpsp_ros.guidance.safety.validation import Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.guidance.times import NEVER, Horizon
from cmpsp_ros.guidance.world import NOT_SEARCHED, World
from cmpsp_ros.world.roads import arc_length_to


class Task(NamedTuple):
    """The task of one control step."""

    is_new: bool  # whether the goal is another one than before
    is_over: bool  # whether the last goal's time has passed
    horizon: Horizon  # the horizon of plans; that of the last plan where it goes on
    goes_on: bool  # whether a new command would come too late to change anything
    note: str  # why the final time was changed, in a sentence; else empty


class GuidanceLaw:
    """Observe, predict, plan, check, select a plan or fall back, record.

    It reads no clock and no file: the same observations give the same decisions, bit for bit.
    Each observation has a `step`, and where that has decided, `after_step` once the command is out.
    """

    def __init__(self, settings: LawSettings, world: World, timer: Callable[[], int] = int) -> None:
        """Start at rest; `timer` gives time [ns] for the computing times in decisions alone."""
        self._timer, self._settings = timer, settings
        self._state = LawState.begin(settings, world, run=0, revision=0)
        self._validator = Validator(settings)
        self._selector = PlanSelector(settings, world, self._validator, timer)
        self._supervisor = Supervisor(settings, self._validator, self._selector)
        self._ahead = PlanAhead(settings, self._selector)
        self._prepare_search()

    def _prepare_search(self) -> None:
        """Search the map for the paths to all goals: it takes longer than a control step."""
        if (search := self.world.map_search(self._settings)) is not None:
            for goal in self._settings.goals:
                search.prepare(goal.position)

    def reset(self) -> None:
        """Begin again: the next odometry is time 0."""
        run, revision = self._state.run + 1, self._state.revision
        known = self._state.world
        if known.seen is not None or known.searched is not NOT_SEARCHED:
            known = replace(known, seen=None, searched=NOT_SEARCHED)
        self._state = LawState.begin(self._settings, known, run, revision)
        self._selector.forget()

    def reconfigure(self, settings: LawSettings, world: World) -> None:
        """Take new settings and another world, from the next control step on."""
        self._state.reconfigure(settings, world)
        known, self._settings = self._settings, settings
        if not settings.has_numbers_of(known):
            self._validator = Validator(settings)
            self._supervisor = Supervisor(settings, self._validator, self._selector)
        self._selector.reconfigure(settings, self.world, self._validator)
        self._ahead = PlanAhead(settings, self._selector)
        self._prepare_search()

    def is_due(self, stamp: int) -> bool:
        """True if odometry of this time [ns] calls for a decision."""
        clock = self._state.clock
        return clock.start is None or stamp - clock.start >= clock.due

    def step(self, observation: Observation) -> Decision | None:
        """Decide; None between two control steps and for odometry older than the last."""
        if not self.is_due(observation.stamp):
            return None
        state, supervisor = self._state, self._supervisor
        state.planned = None
        late = self._observe(observation)
        estimate = self._predict(observation, late)
        ramp = state.following.ramp
        task = self._update_task(observation, estimate)
        if task.is_over:
            return self._record(observation, supervisor.finish(state, observation, estimate))
        step = Step(state, observation, estimate, self._context(estimate, task))
        if task.goes_on:
            decision = supervisor.go_on(step)
        elif late and not task.is_new and state.following.plan is not None:
            decision = supervisor.follow_late(step, late)
        else:
            decision = self._plan(step)
        decision = supervisor.slowed(step, decision, ramp)
        if task.note:
            decision = decision._replace(reason=task.note + decision.reason)
        state.estimator.begin_period(observation, state.following.previous_control)
        self._decide_in_time(estimate, decision)
        state.clock.step += 1
        return self._record(observation, decision)

    def _observe(self, observation: Observation) -> float:
        """Take in sightings and search results; delay of the last command [s]."""
        self._see(observation)
        is_first = observation.sighting is not None and self._state.clock.start is None
        if is_first and not self._settings.moves_final_time:
            # Before time 0 there is time for it.
            self._search(observation)
            self._see(observation)
        clock = self._state.clock
        clock.start = observation.stamp if clock.start is None else clock.start
        clock.now = observation.stamp - clock.start
        return self._state.lateness.begin_step()

    def _see(self, observation: Observation) -> None:
        state, sighting = self._state, observation.sighting
        is_searched = state.mission.searched is not state.world.searched
        if sighting is None and is_searched:
            state.world = replace(state.world, searched=state.mission.searched)
        if sighting is None or (sighting.stamp == state.sighted and not is_searched):
            return
        state.sighted = sighting.stamp
        if is_searched and state.mission.searched.is_another:
            self._selector.request_replanning()
        seen = state.world.seeing(sighting.grid)
        state.world = replace(seen, searched=state.mission.searched)

    def _predict(self, observation: Observation, late: float) -> Estimate:
        """Estimate the pose where the next command takes effect; brake there if late."""
        state = self._state
        previous = state.following.previous_control
        estimate = state.estimator.update(observation, state.world, previous)
        if estimate.model_changed:
            self._selector.restart()
        if late:
            state.following.ramp = self._validator.braking_from(estimate.start)
        return estimate

    def _update_task(self, observation: Observation, estimate: Estimate) -> Task:
        """Find the present goal, and when the next control step falls due."""
        state, settings, start = self._state, self._settings, estimate.start
        mission, clock, delay = state.mission, state.clock, estimate.delay
        goals, now, note = mission.goals, clock.now, ''
        is_new = goals.update(observation.stamp, now, start)
        if settings.moves_final_time and not mission.closed_road.wait_reason:
            tries, is_stuck = not mission.reaches_goal, mission.watch.remedy is not Remedy.NONE
            by = goals.adapt(now + delay, start, may_be_later=tries, is_stuck=is_stuck)
            if by > 0.0:
                mission.idle_steps = 0
                note = f'The final time is put off by {by:.3g} s'
                note += ': the path to the goal takes longer. '
            elif by < 0.0:
                note = f'The final time is {-by:.3g} s earlier: the path to the goal is shorter. '
        period = goals.period
        if now >= goals.end:
            clock.due = now + period
            return Task(is_new, True, Horizon.between([now, clock.due]), False, note)
        mission.final_pose = None
        horizon = remaining(now, period, goals.final)
        clock.due = horizon.edges.item(1)
        # A command that is given later takes effect after the final time.
        last = goals.final - delay
        is_settled = delay > 0 and state.following.plan is not None and last - now < period // 2
        if goals.is_last and (now >= last or is_settled):
            horizon = Horizon.between([now, last if now < last else clock.due])
            return Task(is_new, False, horizon, True, note)
        if delay:
            horizon = remaining(now, period, last)
        return Task(is_new, False, horizon, False, note)

    def _context(self, estimate: Estimate, task: Task) -> PlanningContext:
        """The control step that plans are made for; on the way to another goal, from scratch."""
        state = self._state
        following, target = state.following, state.mission.goals.target
        plan, is_new = following.plan or following.standby, task.is_new and not task.goes_on
        if is_new:
            self._selector.forget()
            following.end_speed, plan = math.inf, None
            state.mission.begin_leg()
            if state.mission.goals.is_return:
                # No road says how.
                plan = return_to_goal(
                    self._settings, target, estimate.start, task.horizon, estimate.delay
                )
        return PlanningContext(
            self._settings,
            estimate.start,
            target,
            task.horizon,
            plan=plan,
            pending=self._pending(estimate),
            halvings=state.lateness.halvings,
            delay=estimate.delay,
            end_speed=following.end_speed,
            ends_at_rest=self._settings.comes_to_rest and not target.drives_on,
        )

    def _plan(self, step: Step) -> Decision:
        """Plan, check, and select: a plan, the previous one, or a stop."""
        supervisor, (state, observation, estimate, context) = self._supervisor, step
        reason = supervisor.reason_not_to_begin(state, estimate)
        if not reason:
            if state.estimator.tracker.new_obstacle_seen:
                self._selector.request_replanning()
            state.following.standby = None
            reason = supervisor.reason_to_stand(state, estimate)
            if not reason and context.plan is None:
                reason = self._ahead.reason_to_prepare(state, observation, context)
                reason = reason or state.mission.search_moves(context)
        if reason:
            return supervisor.decisions.stand(step, reason)
        selected = self._selector.best(context)
        if self._settings.is_soonest:
            context, selected = self._ahead.at_soonest(state, context, selected)
            step = step._replace(context=context)
        state.planned = context, selected
        return supervisor.choose(step, selected)

    def _pending(self, estimate: Estimate) -> Validation | None:
        """Validation on the path under commands given before, if there is one."""
        controls, durations = estimate.under_way
        if not len(durations):
            return None
        return self._validator.check_pending(estimate.here, controls, durations)

    def _decide_in_time(self, estimate: Estimate, decision: Decision) -> None:
        """Decide once more if the last command on the way to a goal may not outlast its time."""
        clock, plan = self._state.clock, decision.plan
        if estimate.delay == 0 or plan is None or len(plan.horizon.durations) > 1:
            return
        last, outlasting = self._state.mission.goals.final - estimate.delay, clock.due - clock.now
        may_outlast = self._supervisor.may_outlast
        if clock.now < last and not may_outlast(estimate.start, plan, outlasting):
            clock.due = last

    def _record(self, observation: Observation, decision: Decision) -> Decision:
        state = self._state
        state.last = observation, state.record(decision, observation.tracks)
        if decision.stamp != state.following.commanded_at:
            # It holds a command of the braking path, no longer than the others.
            state.clock.hold(state.following.commanded_at, state.mission.goals.period)
        return state.last[1]

    def after_step(self, late: float = 0.0) -> Decision:
        """Run the slow tasks of a step, once the command is out; the decision to record.

        If the step took so long that its command was not sent, it took `late` [s]: it is withdrawn.
        """
        assert self._state.last is not None  # noqa: S101 (there was a step)
        observation, decision = self._state.last
        self._state.mission.watch.drive(observation.pose)
        if late:
            self._state.take_back(late)
            why = f'It took {late:.3g} s and was not sent, for it came too late.'
            decision = decision._replace(reason=f'{why} {decision.reason}', late=late)
            self._state.planned = None
        self._search(observation)
        if decision.step == 0 and not decision.finished:
            self._see(observation)
            place = float(observation.pose[0]), float(observation.pose[1])
            found = tuple(infeasibility_warnings(self.task, self.world, place))
            self._state.mission.warnings = found
            decision = decision._replace(reason=' '.join([decision.reason, *found]))
        self._ahead.go_on(self._state)
        return decision

    def _search(self, observation: Observation) -> None:
        """Search the grid for the paths to the next goals, for the control steps that follow."""
        mission, world = self._state.mission, self._state.world
        if mission.searched is not world.searched:
            world = replace(world, searched=mission.searched)
        places = mission.goals.next_positions
        mission.searched = search_ahead(self._settings, world, observation.pose[:2], places)
        if mission.manoeuvres is not None:
            mission.manoeuvres.advance()

    def set_goal(self, stamp: int, goal: Goal) -> None:
        """Replace all goals from a time stamp on [ns], 0 for at once; GoalError if refused."""
        state = self._state
        latest = None if state.clock.start is None else state.clock.start + state.clock.now
        state.mission.goals.receive(stamp, goal, state.world, self._validator, latest)

    def halt(self, stamp: int, reason: str, **flags: Any) -> Decision:
        """Stop at `stamp` [ns] for a reason not seen in odometry; decide on newer odometry at once.

        With a flag of `Decision` (`finished`, `cancelled`, `braking`) it brakes along a ramp.
        """
        state, nowhere = self._state, np.full(3, math.nan)
        self._supervisor.drop_plan(state)
        state.interrupt(is_lost=not any(flags.values()))
        decisions = self._supervisor.decisions
        return state.record(decisions.stop(state, stamp, nowhere, reason, halted=True, **flags))

    @property
    def warnings(self) -> list[str]:
        """Tasks that no plan of the run can fulfil, and parameters that odometry contradicts."""
        return [*self._state.mission.warnings, *self._state.estimator.response.warnings()]

    @property
    def task(self) -> LawSettings:
        """The settings, with the goal that was received instead of theirs where there is one."""
        received = self._state.mission.goals.received
        return self._settings if received is None else self._settings.towards(received)

    @property
    def world(self) -> World:
        """Road and static obstacles, with the seen grid."""
        return self._state.world

    @property
    def ends_at(self) -> int | None:
        """When the robot is to stop at the latest, a time stamp [ns]; None where none is known."""
        start, end = self._state.clock.start, self._state.mission.goals.end
        return None if start is None or end >= NEVER else start + end

    def distance_to(self, pose: Sequence[float], goal: Goal) -> float:
        """Length of the road from a pose (x, y, heading) [m, m, rad] to a goal [m]."""
        road, progress = self._state.world.road, self._state.estimator.progress
        return abs(arc_length_to(road, np.array(pose), goal.position, goal.heading, progress))
