"""Where the robot was: odometry of the last seconds, interpolated."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right

import numpy as np

from cmpsp_ros.arrays import Array, IntArray

Indices = IntArray


class PoseHistory:
    """Poses in the order of their stamps."""

    def __init__(self, span: int) -> None:
        """Know of none.

        Args:
            span: For how long poses are remembered [ns].
        """
        self._span = span
        self._stamps: list[int] = []
        self._poses: list[list[float]] = []

    def add(self, stamp: int, pose: Array) -> None:
        """Remember where the robot is.

        Args:
            stamp: The time [ns]; one that is not later than the last is left out.
            pose: Shape ``(3,)`` [m, m, rad].
        """
        if self._stamps and stamp <= self._stamps[-1]:
            return
        x, y, heading = pose.tolist()
        if self._poses:
            before = self._poses[-1][2]
            heading = before + math.remainder(heading - before, math.tau)
        self._stamps.append(stamp)
        self._poses.append([x, y, heading])
        old = max(bisect_right(self._stamps, stamp - self._span) - 1, 0)
        del self._stamps[:old], self._poses[:old]

    def is_before(self, stamp: int) -> bool:
        """Whether the last pose is older than a time [ns]."""
        return not self._stamps or self._stamps[-1] < stamp

    def is_after(self, stamp: int) -> bool:
        """Whether the first pose is newer than a time [ns]."""
        return bool(self._stamps) and self._stamps[0] > stamp

    def at(self, stamps: Indices) -> Array:
        """Poses at times between the first and the last, ``(K,)`` [ns]; ``(K, 3)`` [m, m, rad]."""
        low = max(bisect_right(self._stamps, stamps.min(initial=self._stamps[-1])) - 1, 0)
        high = bisect_left(self._stamps, stamps.max(initial=self._stamps[0])) + 1
        # An empty cloud has no stamps.
        high, first = max(high, low + 1), self._stamps[low]
        known = np.array(self._stamps[low:high]) - first
        poses = np.array(self._poses[low:high])
        return np.column_stack([np.interp(stamps - first, known, each) for each in poses.T])

    def forget(self) -> None:
        """Know of none again."""
        self._stamps.clear()
        self._poses.clear()
