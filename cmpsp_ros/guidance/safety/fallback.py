"""The last checked plan, where no new one may be followed; and control steps that take too long.

Nothing here reads a clock: how long a step took comes from outside, and is recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import Horizon, shift
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.audit import Audit, Verdict
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.robots import within_ramp

# Halvings of the work of a step, at most, and control steps in time after which one is taken back.
_MOST_HALVINGS: Final = 3
_FORGIVEN: Final = 25

_SPEEDS: Final = (1.0, 0.75, 0.5, 0.25, 0.125)
_INSTANTS: Final = 5


class Fallback:
    """The last audited plan on a later horizon, and how long its last command may go on."""

    def __init__(self, settings: LawSettings, audit: Audit) -> None:
        """Take what a plan must pass.

        Args:
            settings: All settings of the guidance law.
            audit: For what a plan has looked at.
        """
        self._audit, self._max_change = audit, settings.max_wheel_change
        self._margin_audit = Audit(settings, with_margin=True)

    def shifted(
        self,
        plan: Plan | None,
        start: PlanStart,
        horizon: Horizon,
        delay: int,
        pending: Verdict | None,
    ) -> tuple[Plan, Verdict] | None:
        """The last plan, shifted by the time that has passed, if it is still clear.

        Args:
            plan: The last audited plan.
            start: Where it goes on from.
            horizon: The horizon wanted.
            delay: From a command to its effect [ns].
            pending: Verdict on the path to the start.
        """
        if plan is None:
            return None
        controls = shift(plan.controls, plan.horizon, horizon)
        controls = within_ramp(
            controls,
            horizon.durations,
            start.previous_control,
            self._max_change,
            start.robot.time_scaling,
        )
        verdict = self._audit.check(start, controls, horizon.durations, pending)
        if not verdict.passed:
            return None
        poses = start.robot.roll_out(start.pose, controls, horizon.durations)
        return Plan(horizon, controls, poses, delay), verdict

    def may_outlast(self, start: PlanStart, controls: Array, nanoseconds: int) -> bool:
        """Whether the first command may go on for some time.

        No plan has looked at the path beyond its end: it keeps the margin that plans keep, or is
        not driven.
        """
        outlasting = np.array([nanoseconds / NANOSECONDS])
        return self._margin_audit.check(start, controls[:1], outlasting).passed


@dataclass
class Lateness:
    """How late commands are in a run.

    Attributes:
        last: How long the last step took, if its command came too late to be sent; else 0 [s].
        expected: The longest that a step took of those not yet forgiven [s].
        late_steps: Late steps not yet forgiven, as far as they count.
        steps_in_time: Steps in time since the last of them.
    """

    last: float = 0.0
    expected: float = 0.0
    late_steps: int = 0
    steps_in_time: int = 0

    @property
    def halvings(self) -> int:
        """How often the work of a step is halved: a single late step may be chance."""
        return max(self.late_steps - 1, 0)

    def add(self, took: float) -> None:
        """Count a late step that took so long [s]."""
        self.last, self.expected = took, max(self.expected, took)
        self.late_steps = min(self.late_steps + 1, _MOST_HALVINGS + 1)
        self.steps_in_time = 0

    def begin_step(self) -> float:
        """Begin the next step; how long the last one took, if it was too late, else 0 [s]."""
        last, self.last = self.last, 0.0
        if last == 0.0 and self.late_steps:
            self.steps_in_time += 1
            if self.steps_in_time >= _FORGIVEN:
                self.late_steps, self.steps_in_time = self.late_steps - 1, 0
                self.expected = self.expected if self.late_steps else 0.0
        return last


def clear_fraction(
    audit: Audit, here: PlanStart, previous: Array, control: Array, next_step: float, latest: float
) -> float:
    """Largest tried fraction of a command that is clear whenever it comes into effect.

    The command before it goes on until then, and it goes on itself until the next one does. As the
    same was asked of the command before, a stop is clear.

    Args:
        audit: For what the path must be clear of.
        here: Where the robot is.
        previous: The command before, shape ``(r,)``.
        control: The command, shape ``(r,)``.
        next_step: Time until the next control step [s].
        latest: Longest time that a command takes to come into effect [s].
    """
    # One that takes longer than that is never sent.
    instants = np.linspace(0.0, min(latest, next_step), _INSTANTS)
    held = np.stack([instants, next_step + latest - instants], axis=1)
    for fraction in _SPEEDS:
        commands = np.stack([previous, here.robot.slowed(control, fraction)])
        if all(audit.check_pending(here, commands, each).passed for each in held):
            return fraction
    return 0.0
