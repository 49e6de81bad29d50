"""Commands given so far: those in effect, and those pending, which do not drive the robot yet.

A command takes effect `command_delay` after its odometry, and holds until the next one does.
"""

import math
from collections import deque
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.times import NANOSECONDS

_REMEMBERED: Final = 5 * NANOSECONDS  # age of the oldest command kept, beside one before it [ns]
_TWISTS: Final = 64  # number of twists that are kept


class PendingCommands:
    """The commands of one run, as far as they still matter."""

    def __init__(self, n_controls: int = 2) -> None:
        self._before = np.zeros(n_controls)
        self.in_force = self._before  # control in effect at the instant last asked for, ``(r,)``
        self._given: deque[tuple[int, Array]] = deque()
        self._twists: deque[tuple[int, list[float]]] = deque(maxlen=_TWISTS)

    @property
    def latest(self) -> Array:
        """The last command, shape ``(r,)``."""
        return self._given[-1][1] if self._given else self._before

    def add(self, stamp: int, control: Array, twist: Array | None = None) -> None:
        """Remember a command ``(r,)`` for a stamp [ns], not before the last one, and its twist."""
        if self._given:
            stamp = max(stamp, self._given[-1][0])
            while self._given and self._given[0][0] < stamp - _REMEMBERED:
                self._before = self._given.popleft()[1]
        self._given.append((stamp, control))
        if twist is not None:
            self._twists.append((stamp, twist.tolist()))

    def take_back(self) -> Array:
        """Forget the last command, which was never sent; the one before it, shape ``(r,)``."""
        self._given.pop()
        if self._twists:
            self._twists.pop()
        return self.latest

    def until(self, stamp: int, delay: int) -> tuple[Array, Array]:
        """Controls ``(K, r)`` until a command of now [ns] takes effect, and durations [s]."""
        ahead: list[tuple[int, Array]] = []
        self.in_force = self._before
        for at, control in reversed(self._given):
            if at + delay <= stamp:
                self.in_force = control
                break
            if at < stamp:
                ahead.append((at + delay, control))
        if not delay:
            return np.empty((0, len(self.in_force))), np.empty(0)
        ahead.reverse()
        controls = np.array([self.in_force, *(each for _, each in ahead)])
        edges = np.array([stamp, *(at for at, _ in ahead), stamp + delay], dtype=np.int64)
        durations = np.diff(edges) / NANOSECONDS
        lasting = durations > 0.0
        return controls[lasting], durations[lasting]

    def since(self, begin: int, end: int, delay: int) -> tuple[Array, Array]:
        """Controls ``(K, r)`` between two instants [ns], the latest first, and durations [s]."""
        controls, lengths = [], []
        for given, control in reversed(self._given):
            at = given + delay
            if at <= end and end > begin:
                controls.append(control)
                lengths.append((end - max(at, begin)) / NANOSECONDS)
                end = max(at, begin)
        return np.array(controls).reshape(-1, len(self._before)), np.array(lengths)

    def pose_after(
        self, pose: Array, begin: int, end: int, delay: int, grip: float
    ) -> tuple[float, float, float]:
        """Pose to which commands lead a robot that obeys after a delay [ns]: in microseconds."""
        held: list[tuple[list[float], float]] = []
        until = end
        for given, twist in reversed(self._twists):
            at = given + delay
            if at < until:
                if at <= begin:
                    held.append((twist, (until - begin) * 1e-9))
                    break
                held.append((twist, (until - at) * 1e-9))
                until = at
        x, y, heading = pose.tolist()
        for (forward, *left, turn_rate), seconds in reversed(held):
            driven = grip * seconds
            half = 0.5 * turn_rate * driven
            chord = driven * math.sin(half) / half if half else driven
            heading += half
            cosine, sine = chord * math.cos(heading), chord * math.sin(heading)
            x += forward * cosine
            y += forward * sine
            if left:
                x -= left[0] * sine
                y += left[0] * cosine
            heading += half
        return x, y, heading

    def before(self, stamp: int, earliest: int) -> tuple[Array, Array]:
        """Times ``(K,)`` [s] of commands, and controls ``(K + 1, r)`` with the one before."""
        before = self._before
        times: list[float] = []
        controls: list[Array] = []
        for at, control in self._given:
            if at < earliest:
                before = control
            elif at < stamp:
                times.append((at - stamp) / NANOSECONDS)
                controls.append(control)
        return np.array(times), np.array([before, *controls])
