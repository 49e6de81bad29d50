"""What follows a command that came too late, and slower ones before one that may."""

from __future__ import annotations

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder
from cmpsp_ros.guidance.decision import Decision, FallbackLevel
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.safety.fallback import Fallback
from cmpsp_ros.guidance.safety.lateness import clear_fraction
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState


class LateCommands:
    """Goes on with late plans, and slows commands down for the time until they take effect."""

    def __init__(
        self, settings: LawSettings, audit: Audit, fallback: Fallback, decisions: DecisionBuilder
    ) -> None:
        """Take times and limits from the settings.

        Args:
            settings: All settings of the guidance law.
            audit: For what the path must be clear of.
            fallback: Shifts late plans.
            decisions: What makes them.
        """
        self._settings, self._audit = settings, audit
        self._fallback, self._decisions = fallback, decisions

    def follow(
        self, state: LawState, stamp: int, pose: Array, context: PlanningContext, late: float
    ) -> Decision:
        """Follow the plan that came too late, shifted by the time it took, if it is still clear.

        Nothing is solved: that might be late again.

        Args:
            state: Of the law.
            stamp: Time stamp of the odometry [ns].
            pose: Where the robot is, shape ``(3,)`` [m, m, rad].
            context: What plans are for.
            late: How long it took [s].
        """
        start = context.start
        shifted = self._fallback.shifted(
            state.plan, start, context.horizon, context.delay, context.pending
        )
        if shifted is None:
            state.plan, state.waiting = None, context.plan
            reason = f'The computer was late, by {late:.3g} s: its last plan is not clear any more.'
            return self._decisions.stop(state, stamp, pose, reason, moving=start.moving)
        state.plan = shifted[0]
        reason = f'The computer was late, by {late:.3g} s: its last plan goes on.'
        errors = context.goal.errors(state.plan.poses[-1])
        level = FallbackLevel.PREVIOUS_PLAN
        return self._decisions.follow(state, stamp, level, reason, *shifted, errors)

    def slowed(
        self, state: LawState, decision: Decision, here: PlanStart, start: PlanStart, ramp: Array
    ) -> Decision:
        """A decision with a slower command, where a command that is late would not be clear.

        Where no slower one is clear, with a ramp behind it, the robot stops.

        Args:
            state: Of the law, which keeps the slower command and its ramp.
            decision: What is decided.
            here: Where the robot is.
            start: Where the plan begins.
            ramp: By which the robot could be stopped instead, audited, shape ``(K, r)``.
        """
        settings, audit = self._settings, self._audit
        latest = max(state.lateness.expected, settings.max_command_delay)
        plan, commanded, previous = decision.plan, state.previous_control, state.pending.latest
        if plan is None or latest <= settings.command_delay:
            return decision
        next_step = (state.due - state.now) / NANOSECONDS
        fraction = clear_fraction(audit, here, previous, commanded, next_step, latest)
        if fraction == 1.0:
            return decision
        controls = settings.robot.slowed(plan.controls, fraction)
        checked = audit.check(start, controls, plan.horizon.durations)
        if not checked.passed:
            state.previous_control, state.ramp = previous, ramp
            reason = f'The robot stops: no slower command is clear if it is late. {decision.reason}'
            return self._decisions.stop(
                state, decision.stamp, here.pose, reason, moving=here.moving
            )
        state.previous_control, state.ramp = controls[0], checked.ramp
        reason = f'{decision.reason} Slowed to {fraction:.3g} of the speed: commands may be late.'
        wheel_speeds = settings.robot.speeds_of(controls[0])
        twist = settings.robot.twist(controls[0])
        return decision._replace(wheel_speeds=wheel_speeds, twist=twist, reason=reason)
