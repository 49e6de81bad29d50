"""What happens about the final time: a command that is given later takes effect after it."""

from __future__ import annotations

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder
from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.horizon import Horizon, to_nanoseconds
from cmpsp_ros.guidance.horizon_functions import remaining
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.safety.fallback import Fallback
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.world.obstacles import MovingDiscs


class FinalTime:
    """The last commands on the way to a goal, and the stop behind it."""

    def __init__(
        self, settings: LawSettings, fallback: Fallback, decisions: DecisionBuilder
    ) -> None:
        """Take times and tolerances from the settings.

        Args:
            settings: All settings of the guidance law.
            fallback: How long a command may go on.
            decisions: What makes them.
        """
        self._settings, self._fallback, self._decisions = settings, fallback, decisions
        self._period = to_nanoseconds(settings.control_period)

    def horizon(self, state: LawState) -> tuple[Horizon, bool]:
        """The horizon of this step's plan, and whether a new one would come too late.

        The step that is next is recorded in the state.
        """
        now, goals = state.now, state.goals
        horizon = remaining(now, self._period, goals.final)
        state.due = horizon.next_instant
        # A command that is given later takes effect after the final time.
        last = self.last(state)
        if goals.is_last and (now >= last or self._is_settled(state, last - now)):
            return Horizon.between([now, last if now < last else state.due]), True
        return remaining(now, self._period, last) if state.delay else horizon, False

    def put_off(self, state: LawState, start: PlanStart) -> str:
        """Put the final time off where the path to the goal proves too long; why, in a sentence.

        Args:
            state: Of the law.
            start: Where plans begin.
        """
        if not self._settings.may_be_late or state.reaches_goal or state.closed_road.waits:
            return ''
        by = state.goals.postpone(state.now + state.delay, start)
        if not by:
            return ''
        state.idle_steps = 0
        return f'The final time is put off by {by:.3g} s: the path to the goal takes longer. '

    def last(self, state: LawState) -> int:
        """When the last command must be given that takes effect before the goal [ns]."""
        return state.goals.final - state.delay

    def _is_settled(self, state: LawState, left: int) -> bool:
        """Whether the last plan left no more commands for the time that is left [ns]."""
        return state.delay > 0 and state.plan is not None and left < self._period // 2

    def go_on(self, state: LawState, stamp: int, pose: Array, context: PlanningContext) -> Decision:
        """Let the last plan go on, past its end too, where a new command comes too late.

        Too early a stop would cost the goal if the delay is shorter than it is said to be, or the
        wheels rather lag.

        Args:
            state: Of the law.
            stamp: Time stamp of the odometry [ns].
            pose: Where the robot is, shape ``(3,)`` [m, m, rad].
            context: The control step.
        """
        start, plan = context.start, state.plan
        shifted = self._fallback.shifted(plan, start, context.horizon, state.delay, context.pending)
        beyond = state.due - state.now if state.now >= self.last(state) else 0
        if (
            plan is None
            or shifted is None
            or (beyond and not self._fallback.may_outlast(start, shifted[0].controls, beyond))
        ):
            reason = 'No plan can go on until a stop takes effect.'
            return self._decisions.stop(state, stamp, pose, reason, moving=start.moving)
        reason = 'The plan goes on: a new command comes too late to change its end.'
        errors = context.goal.errors(plan.poses[-1])
        level = FallbackLevel.NOMINAL
        return self._decisions.follow(state, stamp, level, reason, *shifted, errors)

    def decide_in_time(self, state: LawState, start: PlanStart, plan: Plan | None) -> None:
        """Decide once more if the last command on the way to a goal may not outlast its time.

        By itself it does, by as long as the next one takes to come into effect: a stop, or the
        first on the way to another goal.

        Args:
            state: Of the law.
            start: Where the plan begins.
            plan: The plan that is followed, if any.
        """
        if state.delay == 0 or plan is None or len(plan.horizon.durations) > 1:
            return
        outlasting, last = state.due - state.now, self.last(state)
        if state.now < last and not self._fallback.may_outlast(start, plan.controls, outlasting):
            state.due = last

    def finish(self, state: LawState, stamp: int, pose: Array, moving: MovingDiscs) -> Decision:
        """Stop after the final time, and judge where the robot was then.

        Args:
            state: Of the law.
            stamp: Time stamp of the odometry [ns].
            pose: Where the robot is, shape ``(3,)`` [m, m, rad].
            moving: Moving obstacles.
        """
        state.due, state.plan = state.now + self._period, None
        has_goal = state.goals.goal is not None
        passed = state.pose_at_end(stamp, pose, self._period) if has_goal else pose
        error, heading_error = state.goals.target.errors(passed)
        off, by = heading_error or 0.0, ''
        if has_goal and error > self._settings.goal_tolerance:
            by = f', {error:.3g} m from the goal'
        elif has_goal and off > self._settings.heading_tolerance:
            by = f", {off:.3g} rad off the goal's heading"
        reason, missed = f'The final time has passed{by}.', bool(by)
        decision = self._decisions.stop(
            state, stamp, pose, reason, moving=moving, finished=True, missed=missed
        )
        return decision._replace(terminal_error=error, heading_error=heading_error)
