"""Decisions, made from what the law remembers and what it has found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import UNTIMED, Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.horizon import NANOSECONDS, NEVER, to_nanoseconds
from cmpsp_ros.guidance.planning.candidate import SolveResult
from cmpsp_ros.guidance.safety.audit import Audit, Verdict
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.robots import speeds_and_turns
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs


class DecisionBuilder:
    """Follows plans and stops, and says so."""

    def __init__(self, settings: LawSettings, audit: Audit) -> None:
        """Take the robot from the settings.

        Args:
            settings: All settings of the guidance law.
            audit: Knows the clearance where the robot stops.
        """
        self._robot, self._period = settings.robot, to_nanoseconds(settings.control_period)
        self._audit = audit

    def follow(
        self,
        state: LawState,
        stamp: int,
        level: FallbackLevel,
        reason: str,
        plan: Plan,
        verdict: Verdict,
        errors: tuple[float, float | None],
        result: SolveResult | None = None,
        phases: Mapping[str, float] = UNTIMED,
    ) -> Decision:
        """Give the first command of a plan.

        Args:
            state: Of the law.
            stamp: Time stamp of the odometry that it answers [ns].
            level: The fallback level.
            reason: Why that level.
            plan: The plan.
            verdict: Of the audit.
            errors: Distance of the plan's end from the goal [m], and of its last heading [rad].
            result: Of the iterations of this step, if there were any.
            phases: Computing time by phase [ms].
        """
        state.follow(plan, verdict)
        controls = plan.controls[0]
        return Decision(
            stamp=stamp,
            step=state.step,
            level=level,
            reason=reason,
            wheel_speeds=self._robot.speeds_of(controls),
            steering_angle=self._robot.steering_of(controls),
            twist=self._robot.twist(controls),
            time_left=_time_left(state, state.now),
            plan=plan,
            terminal_error=errors[0],
            clearance=verdict.margin,
            worst_clearance=verdict.worst_margin,
            failures=state.failures,
            prediction_error=state.response.error,
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
        self,
        state: LawState,
        stamp: int,
        pose: Array,
        reason: str,
        result: SolveResult | None = None,
        moving: MovingDiscs = NOTHING_MOVES,
        **flags: Any,
    ) -> Decision:
        """Stop, or brake as far as the wheels can.

        Args:
            state: Of the law.
            stamp: Time stamp of the odometry that it answers, or of now [ns].
            pose: Where the robot is, NaN if unknown, shape ``(3,)`` [m, m, rad].
            reason: Why.
            result: Of the iterations of this step, if there were any.
            moving: Moving obstacles.
            flags: Other fields of `Decision`.
        """
        state.brake(stamp, self._period)
        twist = self._robot.twist(state.previous_control)
        if np.any(twist) and 'halted' not in flags:
            reason += f' It brakes to {abs(speeds_and_turns(twist)[0]):.3g} m/s.'
        clearance = float(self._audit.clearance_at(state.world, pose, moving, state.progress).min())
        error, heading_error = state.goals.target.errors(pose)
        return Decision(
            stamp=stamp,
            step=state.step,
            level=FallbackLevel.STOP,
            reason=reason,
            wheel_speeds=self._robot.speeds_of(state.previous_control),
            steering_angle=self._robot.steering_of(state.previous_control),
            twist=twist,
            time_left=_time_left(state, 0 if state.start is None else stamp - state.start),
            plan=None,
            terminal_error=error,
            clearance=clearance,
            worst_clearance=clearance,
            failures=state.failures,
            prediction_error=state.response.error,
            run=state.run,
            revision=state.revision,
            goal=state.goals.goal,
            heading_error=heading_error,
            goals_received=state.goals.goals_received,
            iterations=0 if result is None else result.iterations,
            **flags,
        )


def _time_left(state: LawState, elapsed: int) -> float:
    """Time to the last goal [s], so long [ns] after the run began."""
    end = state.goals.end
    return max(0, end - elapsed) / NANOSECONDS if end < NEVER else math.inf
