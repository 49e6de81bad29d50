"""Decisions, made from what the law remembers and what it has found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import UNTIMED, Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.horizon import NANOSECONDS, NEVER
from cmpsp_ros.guidance.planning.candidate import SolveResult
from cmpsp_ros.guidance.safety.audit import Verdict
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.robots.differential_drive import DifferentialDrive

Array = NDArray[np.float64]


def follow(
    state: LawState,
    stamp: int,
    level: FallbackLevel,
    reason: str,
    plan: Plan,
    verdict: Verdict,
    robot: DifferentialDrive,
    errors: tuple[float, float | None],
    result: SolveResult | None = None,
    phases: Mapping[str, float] = UNTIMED,
) -> Decision:
    """To follow a plan.

    Args:
        state: Of the law.
        stamp: Time stamp of the odometry that it answers [ns].
        level: The fallback level.
        reason: Why that level.
        plan: The plan.
        verdict: Of the audit.
        robot: Kinematics by which wheel speeds are commanded.
        errors: Distance of the plan's end from the goal [m], and of its last heading [rad].
        result: Of the iterations of this step, if there were any.
        phases: Computing time by phase [ms].
    """
    controls = plan.controls[0]
    return Decision(
        stamp=stamp,
        step=state.step,
        level=level,
        reason=reason,
        wheel_speeds=controls,
        twist=robot.twist(controls),
        time_left=_time_left(state, state.now),
        plan=plan,
        terminal_error=errors[0],
        clearance=verdict.margin,
        worst_clearance=verdict.worst_margin,
        failures=state.failures,
        run=state.run,
        revision=state.revision,
        goal=state.goals.goal,
        heading_error=errors[1],
        goals_received=state.goals.goals_received,
        slack=result.slack if result is not None and result.elastic else 0.0,
        iterations=0 if result is None else result.iterations,
        qp_iterations=0 if result is None else result.qp_iterations,
        active_rows=0 if result is None else result.active_rows,
        phases=phases,
    )


def stop(
    state: LawState,
    stamp: int,
    pose: Array,
    reason: str,
    clearance: float,
    twist: Array,
    **numbers: Any,
) -> Decision:
    """To stop, or to brake as `state.previous_control` says.

    Args:
        state: Of the law.
        stamp: Time stamp of the odometry that it answers, or of now [ns].
        pose: Where the robot is, NaN if unknown, shape ``(3,)`` [m, m, rad].
        reason: Why.
        clearance: There [m].
        twist: Speed and turn rate commanded, shape ``(2,)`` [m/s, rad/s].
        numbers: Other fields of `Decision`.
    """
    error, heading_error = state.goals.target.errors(pose)
    return Decision(
        stamp=stamp,
        step=state.step,
        level=FallbackLevel.STOP,
        reason=reason,
        wheel_speeds=state.previous_control,
        twist=twist,
        time_left=_time_left(state, 0 if state.start is None else stamp - state.start),
        plan=None,
        terminal_error=error,
        clearance=clearance,
        worst_clearance=clearance,
        failures=state.failures,
        run=state.run,
        revision=state.revision,
        goal=state.goals.goal,
        heading_error=heading_error,
        goals_received=state.goals.goals_received,
        **numbers,
    )


def ending(state: LawState, settings: GuidanceSettings, pose: Array) -> tuple[str, bool]:
    """What to say once the final time has passed, and whether the goal was missed."""
    if state.goals.goal is None:
        return 'The final time has passed.', False
    error, heading_error = state.goals.target.errors(pose)
    off = heading_error or 0.0
    if error > settings.goal_tolerance:
        return f'The final time has passed, {error:.3g} m from the goal.', True
    if off > settings.heading_tolerance:
        return f"The final time has passed, {off:.3g} rad off the goal's heading.", True
    return 'The final time has passed.', False


def _time_left(state: LawState, elapsed: int) -> float:
    """Time to the last goal [s], so long [ns] after the run began."""
    end = state.goals.end
    return max(0, end - elapsed) / NANOSECONDS if end < NEVER else math.inf
