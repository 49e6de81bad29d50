"""What compiled code knows of a robot."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

DIFFERENTIAL_DRIVE: Final = 0
OMNIDIRECTIONAL: Final = 1


class Kinematics(NamedTuple):
    """A robot for compiled code.

    One type for all models: compiled code that holds a robot is the same for each of them.

    Attributes:
        model: Which one it is, of the constants above.
        gain: Of a differential drive the wheel radius [m]; else the fraction of its twist that
            slip leaves.
        arm: Of a differential drive the half track [m].
        wheels: Wheel speeds of a control, as a matrix, shape ``(W, r)``.
        max_wheel_speed: Limit of each of them [rad/s].
        max_speed: Largest speed along the path [m/s].
    """

    model: int
    gain: float
    arm: float
    wheels: NDArray[np.float64]
    max_wheel_speed: float
    max_speed: float
