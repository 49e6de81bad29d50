"""Decisions from the state of the law and its plan, or from the last plan that was checked."""

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import UNTIMED, Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.planning.candidate import SolveResult
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import Estimate, Observation, PlanStart
from cmpsp_ros.guidance.safety.validation import Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.guidance.times import NANOSECONDS, NEVER, remaining, shift, to_nanoseconds
from cmpsp_ros.robots.motion import speeds_and_turns
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs

_SPEEDS: Final = (1.0, 0.75, 0.5, 0.25, 0.125)  # fractions of the speed of a late command
_INSTANTS: Final = 5  # at which it may come into effect


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
        return self._decision(state, times, level, reason, plan, errors, clearances, **fields)

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
        following.brake(stamp, self._period, state.estimator.robot)
        twist = self._robot.twist(following.previous_control)
        if np.any(twist) and 'halted' not in flags:
            reason += f' It brakes to {abs(speeds_and_turns(twist)[0]):.3g} m/s.'
        clearance = float(self._validator.clearance_at(state.world, pose, moving, progress).min())
        errors = state.mission.goals.target.errors(pose)
        flags.setdefault('iterations', 0 if result is None else result.iterations)
        times, clearances = (stamp, state.clock.elapsed(stamp)), (clearance, clearance)
        level = FallbackLevel.STOP
        return self._decision(state, times, level, reason, None, errors, clearances, **flags)

    def _decision(
        self,
        state: LawState,
        times: tuple[int, int],
        level: FallbackLevel,
        reason: str,
        plan: Plan | None,
        errors: tuple[float, float | None],
        clearances: tuple[float, float],
        **fields: Any,
    ) -> Decision:
        control, goals = state.following.previous_control, state.mission.goals
        stamp, elapsed = times
        left = max(0, goals.end - elapsed) / NANOSECONDS if goals.end < NEVER else math.inf
        return Decision(
            stamp=stamp,
            step=state.clock.step,
            level=level,
            reason=reason,
            wheel_speeds=self._robot.speeds_of(control),
            twist=self._robot.twist(control),
            steering_angle=self._robot.steering_of(control),
            time_left=left,
            plan=plan,
            terminal_error=errors[0],
            heading_error=errors[1],
            clearance=clearances[0],
            worst_clearance=clearances[1],
            failures=state.following.failures,
            prediction_error=state.estimator.response.error,
            run=state.run,
            revision=state.revision,
            goal=goals.goal,
            goals_received=goals.goals_received,
            **fields,
        )


class Fallback:
    """The last audited plan on a later horizon, and how long its last command may go on."""

    def __init__(self, settings: LawSettings, validator: Validator) -> None:
        self._validator = validator
        self._period = to_nanoseconds(settings.control_period)
        self._margin_validator = Validator(settings, with_margin=True)

    def shifted(
        self, plan: Plan | None, context: PlanningContext
    ) -> tuple[Plan, Validation] | None:
        """The last plan, shifted by the time that has passed, if it is still clear."""
        if plan is None:
            return None
        horizon = context.horizon
        if horizon.edges[-1] > plan.horizon.edges[-1] + self._period:
            # Put off: to go on beyond its end would lead past the goal.
            begin = int(horizon.edges[0])
            horizon = remaining(begin, self._period, int(plan.horizon.edges[-1]))
        shifted = context.driven(shift(plan.controls, plan.horizon, horizon), horizon)
        start, pending = context.start, context.pending
        verdict = self._validator.check(start, shifted.controls, horizon.durations, pending)
        return (shifted, verdict) if verdict.passed else None

    def may_outlast(self, start: PlanStart, controls: Array, nanoseconds: int) -> bool:
        """True if the first command may go on for so long [ns], with the margin that plans keep."""
        outlasting = np.array([nanoseconds / NANOSECONDS])
        return self._margin_validator.check(start, controls[:1], outlasting).passed


def clear_fraction(
    validator: Validator,
    here: PlanStart,
    previous: Array,
    control: Array,
    next_step: float,
    latest: float,
) -> float:
    """Largest tried fraction of a command ``(r,)`` that is clear whenever it comes into effect.

    The `previous` one ``(r,)`` goes on for `latest` at most, then it does for `next_step` [s].
    """
    # One that takes longer than that is never sent.
    instants = np.linspace(0.0, min(latest, next_step), _INSTANTS)
    held = np.stack([instants, next_step + latest - instants], axis=1)
    for fraction in _SPEEDS:
        commands = np.stack([previous, here.robot.slowed(control, fraction)])
        if all(validator.check_pending(here, commands, each).passed for each in held):
            return fraction
    return 0.0
