"""Where the robot was: odometry of the last seconds, interpolated."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


class PoseHistory:
    """Poses in the order of their stamps."""

    def __init__(self, span: int) -> None:
        """Know of none.

        Args:
            span: For how long poses are remembered [ns].
        """
        self._span = span
        self._stamps: deque[int] = deque()
        self._poses: deque[Array] = deque()

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
            before = float(self._poses[-1][2])
            heading = before + math.remainder(heading - before, math.tau)
        self._stamps.append(stamp)
        self._poses.append(np.array([x, y, heading]))
        while len(self._stamps) > 1 and self._stamps[1] <= stamp - self._span:
            self._stamps.popleft()
            self._poses.popleft()

    def is_before(self, stamp: int) -> bool:
        """Whether the last pose is older than a time [ns]."""
        return not self._stamps or self._stamps[-1] < stamp

    def is_after(self, stamp: int) -> bool:
        """Whether the first pose is newer than a time [ns]."""
        return bool(self._stamps) and self._stamps[0] > stamp

    def at(self, stamps: Indices) -> Array:
        """Poses at times between the first and the last, ``(K,)`` [ns]; ``(K, 3)`` [m, m, rad]."""
        first = self._stamps[0]
        known = np.array(self._stamps) - first
        poses = np.array(self._poses)
        return np.column_stack([np.interp(stamps - first, known, each) for each in poses.T])

    def forget(self) -> None:
        """Know of none again."""
        self._stamps.clear()
        self._poses.clear()
