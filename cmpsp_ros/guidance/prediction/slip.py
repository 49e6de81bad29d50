"""Wheel slip, estimated from the distance driven under the commands given.

A slipping wheel moves the robot by a fraction ``1 - s`` of its turning. The estimate is the
least-squares solution of ``d_i = (1 - s) l_i`` over the control periods so far, with distances
``l_i`` without slip and ``d_i`` driven along the same chord. A period counts only if the wheels
kept their speed: else a lagging wheel looks like a slipping one. The prior is half of the largest
slip: a second lost to unexpected slip cannot be won back, too high a prior leaves time to spare.
"""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.robots import Robot

# Weight of the prior, as if seen over such a length at a time [m]; halved with every period.
_PRIOR_LENGTH: Final = 0.4
_FADING: Final = 0.5

# Change of a wheel's speed, relative to the faster wheel, up to which a speed is a steady one.
_STEADY: Final = 0.1

# The estimate in use follows the present one in steps: each takes new plans from scratch.
_STEP: Final = 0.005
_CHANGE: Final = 0.9 * _STEP


class SlipEstimate:
    """The slip of one run, seen at its control steps."""

    def __init__(self, max_estimate: float) -> None:
        self._prior, self._weight = max_estimate / 2.0, _PRIOR_LENGTH**2
        self._information = self._missed = 0.0
        self.slip = _in_steps(max_estimate / 2.0)  # the estimate in use, a fraction
        self.lose()

    def lose(self) -> None:
        """Leave out the present control period: its wheel motion is unknown."""
        self._began: tuple[int, Array, Array, Array] | None = None

    def begin(self, stamp: int, pose: Array, controls: Array, durations: Array) -> None:
        """Begin a control period at `stamp` [ns]: controls ``(K + 2, r)``, durations [s]."""
        self._began = (stamp, pose, controls, durations)

    def end(self, stamp: int, pose: Array, robot: Robot, max_estimate: float) -> bool:
        """Update the estimate by the pose ``(3,)`` at `stamp` [ns]; True if it has changed."""
        if self._began is None:
            return False
        began, before, controls, durations = self._began
        self._began = None
        rest = (stamp - began) / NANOSECONDS - float(durations.sum())
        wheel_speeds = robot.speeds_of(controls)
        fastest = float(np.abs(wheel_speeds).max())
        if rest <= 0.0 or float(np.ptp(wheel_speeds, axis=0).max()) > _STEADY * fastest:
            return False
        held = np.append(durations, rest)
        x, y, _ = (robot.roll_out(before, controls[1:], held)[-1] - before).tolist()
        length = math.hypot(x, y)
        if length == 0.0:
            return False
        came = ((pose[0] - before[0]) * x + (pose[1] - before[1]) * y) / length
        self._information += length**2
        self._missed += length * (length - float(came))
        found = self._missed + self._weight * self._prior
        slip = min(max(found / (self._information + self._weight), 0.0), max_estimate)
        self._weight *= _FADING
        if abs(slip - self.slip) < _CHANGE:
            return False
        self.slip = _in_steps(slip)
        return True


def _in_steps(slip: float) -> float:
    return round(slip / _STEP) * _STEP
