"""What compiled code knows of a robot."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray

DIFFERENTIAL_DRIVE: Final = 0
OMNIDIRECTIONAL: Final = 1
ACKERMANN: Final = 2
OWN: Final = 3
"""A model of one's own that does not drive sideways; the next one is of one that does."""

OWN_SIDEWAYS: Final = 4

_NO_FUNCTIONS: Final = np.zeros(3, dtype=np.int64)
_NO_VALUES: Final = np.zeros(1)
_NO_SCRATCH: Final = np.zeros((1, 3))


_NONE: Final = np.zeros((0, 0))


class Kinematics(NamedTuple):
    """A robot for compiled code.

    One type for all models: compiled code that holds a robot is the same for each of them.

    Attributes:
        model: Which one it is, of the constants above.
        gain: The wheel radius [m].
        arm: Of a differential drive the half track, of a car the wheel base, of a model of one's
            own the smallest radius that it turns with [m].
        wheels: Wheel speeds of a control, as a matrix, shape ``(W, r)``. Of an omnidirectional
            robot the wheels that are controls come first.
        max_wheel_speed: Limit of each of them [rad/s].
        max_speed: Largest speed along the path [m/s].
        max_steering_angle: Of a car; infinite else [rad].
        twists: Of an omnidirectional robot the twist of a control, forward, to the left and
            turning, as a matrix, shape ``(3, 3)``.
        of_twists: Its inverse, shape ``(3, 3)``.
        functions: Of a model of one's own: addresses of `own.functions`.
        values: Its grip and constants.
        scratch: What its functions write to, shape ``(4, 3)``.
    """

    model: int
    gain: float
    arm: float
    wheels: Array
    max_wheel_speed: float
    max_speed: float
    max_steering_angle: float = math.inf
    twists: Array = _NONE
    of_twists: Array = _NONE
    functions: IntArray = _NO_FUNCTIONS
    values: Array = _NO_VALUES
    scratch: Array = _NO_SCRATCH
