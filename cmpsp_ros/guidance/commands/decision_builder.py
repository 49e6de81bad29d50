"""Decisions, built from the state of the law and its plan."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import UNTIMED, Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.planning.candidate import SolveResult
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import Estimate, Observation
from cmpsp_ros.guidance.safety.validation import Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.guidance.times import NANOSECONDS, NEVER, to_nanoseconds
from cmpsp_ros.robots.motion import speeds_and_turns
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs


class Step(NamedTuple):
    """A control step that is decided on."""

    state: LawState
    seen: Observation
    estimate: Estimate
    context: PlanningContext


class DecisionBuilder:
    """Gives the command of a plan or of a stop, and says so."""

    def __init__(self, settings: LawSettings, validator: Validator) -> None:
        self._robot, self._period = settings.robot, to_nanoseconds(settings.control_period)
        self._validator = validator

    def follow(
        self,
        step: Step,
        level: FallbackLevel,
        reason: str,
        plan: Plan,
        verdict: Validation,
        errors: tuple[float, float | None],
        result: SolveResult | None = None,
        phases: Mapping[str, float] = UNTIMED,
    ) -> Decision:
        """Give the first command of a plan; `errors` [m], [rad], `phases` [ms]."""
        state, following = step.state, step.state.following
        following.previous_control, following.ramp = plan.controls[0], verdict.ramp
        fields: dict[str, Any] = {'phases': phases}
        if result is not None:
            fields['slack'] = result.slack if result.elastic else 0.0
            fields['iterations'], fields['active_rows'] = result.iterations, result.active_rows
            fields['qp_iterations'] = result.qp_iterations
        clearances = verdict.margin, verdict.worst_margin
        times = step.seen.stamp, state.clock.now
        return self._decision(state, times, level, reason, plan, errors, clearances, fields)

    def stand(self, step: Step, reason: str, result: SolveResult | None = None) -> Decision:
        """Stop at a control step, or brake as far as the wheels can."""
        stamp, pose, *_ = step.seen
        moving = step.context.start.moving
        return self.stop(step.state, stamp, pose, reason, result, moving=moving)

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
        """Stop at `stamp` [ns], or brake as far as the wheels can; `pose` ``(3,)`` [m, m, rad]."""
        following, progress = state.following, state.estimator.progress
        # The node has waited for it, by another clock than that of odometry.
        is_due = flags.get('braking', False)
        following.brake(stamp, self._period, state.estimator.robot, is_due=is_due)
        twist = self._robot.twist(following.previous_control)
        if np.any(twist) and 'halted' not in flags:
            reason += f' It brakes to {abs(speeds_and_turns(twist)[0]):.3g} m/s.'
        clearance = float(self._validator.clearance_at(state.world, pose, moving, progress).min())
        errors = state.mission.goals.target.errors(pose)
        flags.setdefault('iterations', 0 if result is None else result.iterations)
        times, clearances = (stamp, state.clock.elapsed(stamp)), (clearance, clearance)
        level = FallbackLevel.STOP
        return self._decision(state, times, level, reason, None, errors, clearances, flags)

    def _decision(
        self,
        state: LawState,
        times: tuple[int, int],
        level: FallbackLevel,
        reason: str,
        plan: Plan | None,
        errors: tuple[float, float | None],
        clearances: tuple[float, float],
        fields: Mapping[str, Any],
    ) -> Decision:
        control, goals, robot = state.following.previous_control, state.mission.goals, self._robot
        stamp, elapsed = times
        left = max(0, goals.end - elapsed) / NANOSECONDS if goals.end < NEVER else math.inf
        wheel_speeds, twist = robot.speeds_of(control), robot.twist(control)
        # What has no default is given by position: so many keywords take microseconds.
        return Decision(
            state.clock.step,
            stamp,
            level,
            reason,
            left,
            wheel_speeds,
            robot.steering_of(control),
            twist,
            plan,
            errors[0],
            *clearances,
            failures=state.following.failures,
            prediction_error=state.estimator.response.error,
            run=state.run,
            revision=state.revision,
            goal=goals.goal,
            heading_error=errors[1],
            goals_received=goals.goals_received,
            **fields,
        )
