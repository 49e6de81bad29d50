"""Wheels that follow a command with a first-order lag, as a course of constant wheel speeds.

The speed ``w`` of a wheel obeys ``T dw/dt = u - w`` under the command ``u``, so that ``t`` after a
change ``w = u + (w_0 - u) exp(-t/T)``. In each slice of `SLICE` the wheels here hold the mean of
that speed. The angle that each wheel turns, and with it the robot's heading, is then exact at every
end of a slice, and the path is made of the same exact arcs as without lag: whoever knows its
changes can draw it again. Of the position a change neglects some ``v D SLICE^2 / 12``, with the
speed ``v`` and the change ``D`` of the turn rate: 3e-6 m for 1.5 m/s and 1 rad/s.
"""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.arrays import Array

SLICE_NS = 5_000_000
"""Length of a slice [ns]."""

_SLICE = SLICE_NS / 1_000_000_000

_SETTLED = 1e-9
"""Distance from the command at which a wheel counts as having reached it [rad/s]."""


class LaggedWheels:
    """A control after one change of the command.

    Attributes:
        target: Command, shape ``(r,)``.
        slices: Slices until it is reached; 0 without lag.
    """

    def __init__(self, speeds: Array, target: Array, time_constant: float) -> None:
        """Begin a change.

        Args:
            speeds: Control in effect at this instant, shape ``(r,)``.
            target: Command from now on, shape ``(2,)`` [rad/s].
            time_constant: ``T``; 0 is no lag [s].
        """
        self.target = target
        self._gap = speeds - target
        self._rate = 1.0 / time_constant if time_constant > 0.0 else math.inf
        gap = float(np.abs(self._gap).max())
        decades = math.log(gap / _SETTLED) if gap > _SETTLED else 0.0
        # A lag so short that its inverse is infinite is none.
        slices = decades / (_SLICE * self._rate)
        self.slices = math.ceil(slices) if self._rate < math.inf else 0

    def at(self, elapsed: float) -> Array:
        """Control in effect at an instant, shape ``(r,)``.

        Args:
            elapsed: Time since the change [s].
        """
        if self.slices == 0:
            return self.target
        speeds: Array = self.target + self._gap * math.exp(-elapsed * self._rate)
        return speeds

    def means(self, first: int, end: int) -> Array:
        """Mean speeds in some slices.

        Args:
            first: The first of them.
            end: The one after the last; there is no change after slice number `slices`.

        Returns:
            Shape ``(end - first, r)``.
        """
        means = np.repeat(self.target[None], end - first, axis=0)
        if self.slices == 0:
            return means
        ratio = _SLICE * self._rate
        share = -math.expm1(-ratio) / ratio
        # One by one: vectors of other lengths may be rounded otherwise.
        left = [math.exp(-k * ratio) * share if k < self.slices else 0.0 for k in range(first, end)]
        means += np.array(left)[:, None] * self._gap
        return means
