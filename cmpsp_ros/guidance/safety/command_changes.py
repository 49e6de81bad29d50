"""Limits of the change from one command to the next: acceleration and jerk of the wheels."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings

CHANGE_ROUNDING: Final = 1e-6
"""Excess that a solver may leave over a limit on the change of a wheel's speed [rad/s]."""


def reason_not_to_change(settings: LawSettings, start: PlanStart, controls: Array) -> str:
    """Reason not to send the first of some controls ``(K, r)``, in a sentence; '' for none.

    All must keep the limit of acceleration, the first that of jerk.
    """
    commands, robot = np.vstack([start.previous_control, controls]), start.robot
    limit = settings.max_wheel_change
    change = float(np.abs(np.diff(commands, axis=0) @ robot.rate_limits.T).max())
    if not change <= limit + CHANGE_ROUNDING:
        return (
            f'The plan changes a wheel by {change!r} rad/s from one command to the next, the'
            f' limit is {limit!r} rad/s.'
        )
    if (limit := settings.max_second_difference) == math.inf:
        return ''
    second = controls[0] - start.previous_control - start.previous_change
    change = float(np.abs(robot.wheels @ second).max())
    if change <= limit + CHANGE_ROUNDING:
        return ''
    return (
        f'The plan changes the acceleration of a wheel by {change!r} rad/s per control period, the'
        f' limit is {limit!r} rad/s.'
    )
