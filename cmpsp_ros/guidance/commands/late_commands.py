"""Slower commands, where one that comes late would not find its path clear."""

from __future__ import annotations

from cmpsp_ros.guidance.decision import Decision
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.safety.lateness import clear_fraction
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.robots.acceleration import least_scale


def slowed_for_lateness(
    audit: Audit,
    settings: GuidanceSettings,
    state: LawState,
    decision: Decision,
    here: PlanStart,
    start: PlanStart,
) -> Decision:
    """A decision with a slower command, where a command that is late would not be clear.

    Args:
        audit: For what the path must be clear of.
        settings: All settings of the guidance law.
        state: Of the law, which keeps the slower command and its ramp.
        decision: What is decided.
        here: Where the robot is.
        start: Where the plan begins.
    """
    latest = max(state.lateness.expected, settings.max_command_delay)
    plan, commanded, previous = decision.plan, decision.wheel_speeds, state.pending.latest
    if plan is None or latest <= settings.command_delay:
        return decision
    next_step = (state.due - state.now) / NANOSECONDS
    fraction = clear_fraction(audit, here, previous, commanded, next_step, latest)
    fraction = max(fraction, least_scale(commanded, previous, settings.max_wheel_change))
    if fraction == 1.0:
        return decision
    controls = state.previous_control = fraction * commanded
    checked = audit.check(start, fraction * plan.controls, plan.horizon.durations)
    state.ramp = checked.ramp if checked.passed else fraction * state.ramp
    reason = f'{decision.reason} Slowed to {fraction:.3g} of the speed: commands may be late.'
    twist = settings.robot.twist(controls)
    return decision._replace(wheel_speeds=controls, twist=twist, reason=reason)
