"""Slower commands, where one that comes late would not find its path clear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.commands.decision_builder import DecisionBuilder
from cmpsp_ros.guidance.decision import Decision
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.safety.lateness import clear_fraction
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.guidance.state import LawState

Array = NDArray[np.float64]


class LateCommands:
    """Slows commands down for the time that they may take to come into effect."""

    def __init__(
        self, settings: GuidanceSettings, audit: Audit, decisions: DecisionBuilder
    ) -> None:
        """Take times and limits from the settings.

        Args:
            settings: All settings of the guidance law.
            audit: For what the path must be clear of.
            decisions: What makes them.
        """
        self._settings, self._audit, self._decisions = settings, audit, decisions

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
            ramp: By which the robot could be stopped instead, audited, shape ``(K, 2)`` [rad/s].
        """
        settings, audit = self._settings, self._audit
        latest = max(state.lateness.expected, settings.max_command_delay)
        plan, commanded, previous = decision.plan, decision.wheel_speeds, state.pending.latest
        if plan is None or latest <= settings.command_delay:
            return decision
        next_step = (state.due - state.now) / NANOSECONDS
        fraction = clear_fraction(audit, here, previous, commanded, next_step, latest)
        if fraction == 1.0:
            return decision
        controls = fraction * plan.controls
        checked = audit.check(start, controls, plan.horizon.durations)
        if not checked.passed:
            state.previous_control, state.ramp = previous, ramp
            reason = f'The robot stops: no slower command is clear if it is late. {decision.reason}'
            return self._decisions.stop(
                state, decision.stamp, here.pose, reason, moving=here.moving
            )
        state.previous_control, state.ramp = controls[0], checked.ramp
        reason = f'{decision.reason} Slowed to {fraction:.3g} of the speed: commands may be late.'
        twist = settings.robot.twist(controls[0])
        return decision._replace(wheel_speeds=controls[0], twist=twist, reason=reason)
