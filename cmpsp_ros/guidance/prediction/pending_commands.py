"""Pending commands: given, but not in effect yet. They drive the robot until a new one does.

A command takes effect `command_delay` after the stamp of the odometry that it answers, and holds
until the next one takes effect. So the robot will be driven by the commands before for as long as
the delay lasts, and a plan can begin only where they leave it.
"""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import NANOSECONDS

Array = NDArray[np.float64]


_KEPT = 8
"""Commands that are remembered of those that took effect."""


class PendingCommands:
    """The commands of one run, as far as they still matter."""

    def __init__(self, n_controls: int = 2) -> None:
        """Begin with a robot that stands still.

        Args:
            n_controls: Number of its controls.
        """
        self._given: deque[tuple[int, Array]] = deque()
        self._in_force = np.zeros(n_controls)
        self._in_effect: deque[tuple[int, Array]] = deque(maxlen=_KEPT)

    @property
    def in_force(self) -> Array:
        """The control in effect at the instant last asked for, shape ``(r,)``."""
        return self._in_force

    @property
    def latest(self) -> Array:
        """The last command, shape ``(r,)``."""
        return self._given[-1][1] if self._given else self._in_force

    def add(self, stamp: int, control: Array) -> None:
        """Remember a command.

        Args:
            stamp: Time that it answers [ns]; one before the last one's is taken for that one's,
                for no command overtakes another.
            control: The command, shape ``(r,)``.
        """
        if self._given:
            stamp = max(stamp, self._given[-1][0])
        self._given.append((stamp, control))

    def take_back(self) -> Array:
        """Forget the last command, which was never sent; the one before it, shape ``(r,)``."""
        self._given.pop()
        return self.latest

    def until(self, stamp: int, delay: int) -> tuple[Array, Array]:
        """What the wheels do from an instant on until a command given then takes effect.

        What was over before is forgotten: instants must not go back.

        Args:
            stamp: The instant [ns].
            delay: Time from a command's stamp to its effect [ns].

        Returns:
            Controls ``(K, r)``, and for how long each holds ``(K,)`` [s]; nothing without a delay.
        """
        while self._given and self._given[0][0] + delay <= stamp:
            at, self._in_force = self._given.popleft()
            self._in_effect.append((at + delay, self._in_force))
        if not delay:
            return np.empty((0, len(self._in_force))), np.empty(0)
        ahead = [(at + delay, speeds) for at, speeds in self._given if at < stamp]
        speeds = np.array([self._in_force, *(each for _, each in ahead)])
        edges = np.array([stamp, *(at for at, _ in ahead), stamp + delay], dtype=np.int64)
        durations = np.diff(edges) / NANOSECONDS
        lasting = durations > 0.0
        return speeds[lasting], durations[lasting]

    def since(self, begin: int, end: int, delay: int) -> tuple[Array, Array]:
        """What the wheels did between two instants, the latest first.

        Args:
            begin: The earlier instant [ns], not long ago.
            end: The later one [ns], which was asked for last.
            delay: Time from a command's stamp to its effect [ns].

        Returns:
            Controls ``(K, r)``, and for how long each held ``(K,)`` [s].
        """
        self.until(end, delay)
        speeds, lengths = [], []
        for at, each in reversed(self._in_effect):
            if end > begin:
                speeds.append(each)
                lengths.append((end - max(at, begin)) / NANOSECONDS)
                end = min(end, max(at, begin))
        return np.array(speeds).reshape(-1, len(self._in_force)), np.array(lengths)
