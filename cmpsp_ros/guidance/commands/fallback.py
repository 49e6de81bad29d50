"""The last checked plan, where no new one may be followed; and control steps that take too long."""

from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import remaining, shift
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.validation import Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS, to_nanoseconds

_SPEEDS: Final = (1.0, 0.75, 0.5, 0.25, 0.125)  # fractions of the speed of a late command
_INSTANTS: Final = 5  # at which it may come into effect


class Fallback:
    """The last audited plan on a later horizon, and how long its last command may go on."""

    def __init__(self, settings: LawSettings, validator: Validator) -> None:
        self._validator = validator
        self._period = to_nanoseconds(settings.control_period)
        self._margin_validator = validator.with_margin(settings.safety.margin)

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
