"""From the selected plan to the decision: follow it, fall back, slow down or stop."""

import math

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder, Step
from cmpsp_ros.guidance.commands.fallback import Fallback, clear_fraction
from cmpsp_ros.guidance.commands.looking import turn_to_look
from cmpsp_ros.guidance.commands.making_way import (
    PATIENCE,
    Checks,
    Choice,
    MakingWay,
    meets_soon,
    reason_to_wait,
    turns,
)
from cmpsp_ros.guidance.commands.recovery import Recovery
from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.plan_selector import PlanSelector
from cmpsp_ros.guidance.prediction.estimator import Estimate, Observation, PlanStart
from cmpsp_ros.guidance.safety.approach import STANDSTILL, Approach, Conditions, Contact
from cmpsp_ros.guidance.safety.validation import TOUCHING, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.guidance.times import NANOSECONDS, to_nanoseconds


class Supervisor:
    """Selects the plan to follow and its speed, or stops the robot."""

    def __init__(self, settings: LawSettings, validator: Validator, selector: PlanSelector) -> None:
        self._settings, self._validator, self._selector = settings, validator, selector
        self._period = to_nanoseconds(settings.control_period)
        self._fallback = Fallback(settings, validator)
        self._approach = Approach(settings, validator)
        self.decisions = DecisionBuilder(settings, validator)
        checks = Checks(validator, self._approach, self.decisions)
        self._making_way = MakingWay(settings, checks)
        self._recovery = Recovery(settings, checks, self.drop_plan)

    def reason_not_to_begin(self, state: LawState, estimate: Estimate) -> str:
        """Why no plan begins where the robot is, in a sentence; empty for no reason."""
        if state.following.plan is not None:
            return ''
        return self._validator.why_no_start(estimate.start.world, estimate.here.pose)

    def reason_to_stand(self, state: LawState, estimate: Estimate) -> str:
        """Why not even to plan, in a sentence; empty for no reason."""
        error, allowed = state.estimator.response.error, self._settings.safety.max_prediction_error
        if error > allowed > 0.0:
            return (
                f'Odometry is {error:.2g} m from where the commands lead, more than {allowed} m'
                ' (safety.max_prediction_error).'
            )
        wait_reason = state.mission.closed_road.wait_reason
        return '' if wait_reason and meets_soon(self._settings, estimate.start) else wait_reason

    def choose(self, step: Step, selected: Candidate) -> Decision:
        """Follow the selected plan or the previous one, no faster than is safe; or stop."""
        state, context = step.state, step.context
        mission, start = state.mission, context.start
        reached, mission.reaches_goal = mission.reaches_goal, False
        closed = self._closed_ahead(step, selected)
        under = self._conditions(step)
        choose = self._fall_back
        if selected.admissible or self._clears_slowly(selected, under):
            choose = self._accept
        choice = None
        if start.moving.names or state.following.refuge is not None:
            choice = self._making_way.choose(step, selected)
        is_counted = choice is None and (not reached or mission.watch.steps > 0)
        if is_counted and not meets_soon(self._settings, start):
            choice = self._recovery.choose(step, reached=reached)
        choice = choice or choose(step, selected, closed)
        if isinstance(choice, Decision):
            return choice
        level, reason, plan, verdict, ahead, standby = choice
        if closed is not None and (ahead is None or closed.speed < ahead.speed):
            ahead = closed
        # It is improved unslowed: the contact that slows it down may be an error.
        state.following.plan = plan
        if standby is not None:
            state.following.wait(standby)
        self._drop_plan_after_failures(state)
        limited = self._approach.limited(plan, verdict, ahead, under)
        if limited is None:
            why = verdict.reason or 'No speed is clear of what its response may be.'
            reason = f'The robot stops. {why} {reason}'
            return self.decisions.stand(step, reason, selected.result)
        if standby is None and start.reachable.names:
            limited = turn_to_look(self._validator, context, limited[0]) or limited
        slower, verdict, remark = limited
        errors = selected.terminal_error, selected.heading_error
        if plan is not selected.plan:
            errors = context.goal.errors(plan.poses[-1])
        error = errors[0] if slower is plan else context.goal.errors(slower.poses[-1])[0]
        is_clear = verdict.worst_margin >= -TOUCHING
        mission.reaches_goal = is_clear and error <= self._settings.goal_tolerance
        result, phases = selected.result, self._selector.improver.phases
        return self.decisions.follow(
            step, level, reason + remark, slower, verdict, errors, result, phases
        )

    def _conditions(self, step: Step) -> Conditions:
        estimator = step.state.estimator
        risk = estimator.response.risk(step.seen.stamp, estimator.commands)
        return Conditions(step.context.start, step.context.pending, step.estimate.here, risk)

    def _clears_slowly(self, selected: Candidate, under: Conditions) -> bool:
        """True if a plan that something could run into is clear at a lower speed."""
        if not (selected.result.solved and under.start.reachable.names):
            return False
        return self._approach.calmed(selected.plan, selected.verdict, under) is not None

    def _accept(self, step: Step, selected: Candidate, closed: Contact | None) -> Choice | Decision:
        """Follow an admissible plan, or stop where it leads nowhere."""
        state, start = step.state, step.context.start
        following = state.following
        verdict, plan = selected.verdict, selected.plan
        following.failures = 0
        level = FallbackLevel.ELASTIC if selected.is_relaxed else FallbackLevel.NOMINAL
        reason = selected.describe(self._validator, self._settings, start) + self._selector.remark
        ahead = self._approach.contact(plan, start, verdict.worst_margin)
        # On a road that is followed, plans have no end.
        ends_there = state.mission.goals.goal is not None
        ends_there &= selected.terminal_error <= self._settings.goal_tolerance
        if selected.is_relaxed:
            following.end_speed = math.inf
        elif ahead is not None and ends_there:
            end_speed = self._approach.end_speed(plan, ahead)
            following.end_speed = min(following.end_speed, end_speed)
        if why := self._stop_reason(step, selected, ahead, closed):
            following.wait(plan)
            if ahead is not None and start.world.map_search(self._settings) is not None:
                self.drop_plan(state)
                why += ' Another path is searched from here.'
            return self.decisions.stand(step, f'{why} {reason}', selected.result)
        return Choice(level, reason, plan, verdict, ahead)

    def _fall_back(
        self, step: Step, selected: Candidate, closed: Contact | None
    ) -> Choice | Decision:
        """Follow the previous plan, shifted, if it is still clear; or stop."""
        state, context, result = step.state, step.context, selected.result
        state.following.failures += 1
        reason = selected.verdict.reason if result.solved else result.reason
        shifted = self._fallback.shifted(state.following.plan, context)
        if shifted is None:
            state.mission.idle_steps = PATIENCE
            if closed is not None:
                reason = f'{state.mission.closed_road.wait_before(closed)} {reason}'
            self._drop_plan_after_failures(state)
            return self.decisions.stand(step, reason, result)
        plan, verdict = shifted
        ahead = self._approach.contact(plan, context.start, verdict.worst_margin)
        reason += ' The last audited plan goes on.'
        return Choice(FallbackLevel.PREVIOUS_PLAN, reason, plan, verdict, ahead)

    def _closed_ahead(self, step: Step, selected: Candidate) -> Contact | None:
        """Obstacles that close the road; not checked while plans lead to the goal."""
        settings, state, start = self._settings, step.state, step.context.start
        closed_road = state.mission.closed_road
        fails = not selected.feasible or selected.verdict.worst_margin < -TOUCHING
        if not (fails or closed_road.obstacles) or meets_soon(settings, start):
            return None
        if fails:
            closed_road.look(settings, start, step.context.goal)
        if not closed_road.obstacles:
            return None
        return closed_road.update(settings, self._approach, start, state.clock.now)

    def _stop_reason(
        self, step: Step, selected: Candidate, ahead: Contact | None, closed: Contact | None
    ) -> str:
        """Count steps without progress; reason to stop rather than follow a plan, '' if none."""
        mission, context, now, why = step.state.mission, step.context, step.state.clock.now, ''
        is_near = closed is not None and closed.speed < self._settings.robot.max_speed
        if not selected.result.elastic:
            mission.idle_steps = 0
        # Before a moving obstacle it is not safe to wait.
        elif not meets_soon(self._settings, context.start):
            idle_steps = PATIENCE if is_near else mission.idle_steps
            why, mission.idle_steps = reason_to_wait(idle_steps, context, selected)
        if closed is not None:
            if (why and is_near) or mission.closed_road.comes_no_nearer(closed, now):
                return mission.closed_road.wait_before(closed)
            return why
        is_at_rest = ahead is not None and ahead.speed < STANDSTILL and not turns(selected.plan)
        return f'The robot stops: {ahead}' if not why and is_at_rest else why

    def follow_late(self, step: Step, late: float) -> Decision:
        """Follow the plan that came too late [s], shifted, if it is still clear; solve nothing."""
        following, context = step.state.following, step.context
        shifted = self._fallback.shifted(following.plan, context)
        if shifted is None:
            following.wait(context.plan)
            reason = f'The computer was late, by {late:.3g} s: its last plan is not clear any more.'
            return self.decisions.stand(step, reason)
        plan, verdict = shifted
        following.plan = plan
        reason = f'The computer was late, by {late:.3g} s: its last plan goes on.'
        errors, level = context.goal.errors(plan.poses[-1]), FallbackLevel.PREVIOUS_PLAN
        return self.decisions.follow(step, level, reason, plan, verdict, errors)

    def slowed(self, step: Step, decision: Decision, ramp_before: Array) -> Decision:
        """A decision, slower where its command, if late, would not be clear; else a stop."""
        settings, validator, state = self._settings, self._validator, step.state
        here, start, following = step.estimate.here, step.estimate.start, state.following
        plan = decision.plan
        latest = max(state.lateness.expected, settings.max_command_delay)
        if plan is None or latest <= settings.command_delay:
            return decision
        previous = state.estimator.commands.latest
        next_step = (state.clock.due - state.clock.now) / NANOSECONDS
        commanded = following.previous_control
        fraction = clear_fraction(validator, here, previous, commanded, next_step, latest)
        if fraction == 1.0:
            return decision
        controls = settings.robot.slowed(plan.controls, fraction)
        checked = validator.check(start, controls, plan.horizon.durations)
        if not checked.passed:
            following.previous_control, following.ramp = previous, ramp_before
            reason = f'The robot stops: no slower command is clear if it is late. {decision.reason}'
            return self.decisions.stop(state, decision.stamp, here.pose, reason, moving=here.moving)
        following.previous_control, following.ramp = controls[0], checked.ramp
        reason = f'{decision.reason} Slowed to {fraction:.3g} of the speed: commands may be late.'
        wheel_speeds = settings.robot.speeds_of(controls[0])
        twist = settings.robot.twist(controls[0])
        return decision._replace(wheel_speeds=wheel_speeds, twist=twist, reason=reason)

    def go_on(self, step: Step) -> Decision:
        """Let the last plan go on, past its end too, where a new command comes too late."""
        # Too early a stop would cost the goal if the delay is shorter than declared, or a lag.
        state, context, clock = step.state, step.context, step.state.clock
        limited, shifted = None, self._fallback.shifted(state.following.plan, context)
        if shifted is not None:
            limited = self._approach.limited(*shifted, None, self._conditions(step))
        is_beyond = clock.now >= state.mission.goals.final - context.delay
        beyond = clock.due - clock.now if is_beyond else 0
        if limited is None or (beyond and not self.may_outlast(context.start, limited[0], beyond)):
            return self.decisions.stand(step, 'No plan can go on until a stop takes effect.')
        assert state.following.plan is not None  # noqa: S101 (it was shifted)
        plan, verdict, remark = limited
        reason = 'The plan goes on: a new command comes too late to change its end.'
        errors = context.goal.errors(state.following.plan.poses[-1])
        level, reason = FallbackLevel.NOMINAL, reason + remark
        return self.decisions.follow(step, level, reason, plan, verdict, errors)

    def may_outlast(self, start: PlanStart, plan: Plan, nanoseconds: int) -> bool:
        """True if the first command of a plan may go on for so long."""
        return self._fallback.may_outlast(start, plan.controls, nanoseconds)

    def finish(self, state: LawState, seen: Observation, estimate: Estimate) -> Decision:
        """Stop after the final time, and judge where the robot was then."""
        goals, settings = state.mission.goals, self._settings
        state.following.plan = None
        has_goal, passed = goals.goal is not None, seen.pose
        if has_goal:
            end = (state.clock.start or 0) + goals.end
            if state.mission.final_pose is None and 0 < seen.stamp - end <= self._period:
                # Odometry need not meet the final time.
                before = state.estimator.pose_before(seen.stamp, seen.pose, end)
                state.mission.final_pose = before
            passed = seen.pose if state.mission.final_pose is None else state.mission.final_pose
        error, heading_error = goals.target.errors(passed)
        off, by = heading_error or 0.0, ''
        if has_goal and error > settings.goal_tolerance:
            by = f', {error:.3g} m from the goal'
        elif has_goal and off > settings.heading_tolerance:
            by = f", {off:.3g} rad off the goal's heading"
        mission, moving = state.mission, estimate.here.moving
        if by:
            self._recovery.explain_miss(state, estimate.here)
        reason = mission.unreachable or f'The final time has passed{by}.'
        if by and not mission.unreachable and mission.closed_road.wait_reason:
            reason += f' {mission.closed_road.wait_reason}'
        decision = self.decisions.stop(
            state, seen.stamp, seen.pose, reason, moving=moving, finished=True, missed=bool(by)
        )
        return decision._replace(terminal_error=error, heading_error=heading_error)

    def drop_plan(self, state: LawState) -> None:
        """Follow no plan, and search all ways afresh."""
        state.following.wait(None)
        self._selector.forget()

    def _drop_plan_after_failures(self, state: LawState) -> None:
        if state.following.failures >= self._settings.failure_tolerance:
            self.drop_plan(state)
