"""Lag of the wheels, estimated from where the robot came with the commands that it was given.

Some lags up to the longest are tried side by side: for each of them the wheels follow the commands,
and move the robot from where odometry last was to where it should be by now. The squared distances
from where it is instead sum up to a misfit ``S`` of each lag. With ``n`` periods and errors of
``sigma`` each, a lag is possible as long as

    S - min S <= (5 sigma)^2,   sigma^2 = max(min S / n, (2 mm)^2)

which is the likelihood-ratio interval of five standard deviations. What no lag explains, as slip or
a push, makes ``sigma`` larger and the interval wider.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.robots.acceleration import with_lag
from cmpsp_ros.robots.robot import Robot

Array = NDArray[np.float64]

_COUNT: Final = 12
"""Lags that are tried, evenly spaced up to the longest."""

_SLICES: Final = 4
"""Arcs in which the robot is moved while wheels change their speeds."""

_LEAST_ERROR: Final = 0.002
"""Error of a period that is always allowed for [m]."""

_DEVIATIONS: Final = 5.0


class LagEstimate:
    """The lag of one run, seen at its control steps."""

    def __init__(self, max_lag: float, n_controls: int = 2) -> None:
        """Begin at rest, with any lag possible.

        Args:
            max_lag: The longest [s]; 0 where none is considered.
            n_controls: Number of controls of the robot.
        """
        self._wheels, self._poses = np.zeros((_COUNT, n_controls)), np.zeros((_COUNT, 3))
        self._at = 0
        self.reconfigure(max_lag)

    def reconfigure(self, max_lag: float) -> None:
        """Begin again with another longest lag [s]; the wheels go on as they are."""
        self._lags = [max_lag * (k + 1) / _COUNT for k in range(_COUNT)]
        self._misfits, self._periods = np.zeros(_COUNT), 0
        self._first, self._last = 0, _COUNT - 1
        self.lose()

    def lose(self) -> None:
        """Leave out the present control period: what the wheels do in it is unknown."""
        self._has_begun = False

    @property
    def figures(self) -> tuple[float, float, float] | None:
        """The lag that is compensated, the least that is possible and the longest [s].

        None where none is considered.
        """
        least = self._lags[self._first - 1] if self._first else 0.0
        figures = self.best[0] / NANOSECONDS, least, self._lags[self._last]
        return figures if self._lags[-1] > 0.0 else None

    @property
    def best(self) -> tuple[int, Array]:
        """The lag that fits best [ns], and the wheels by now [rad/s]; 0 while there may be none.

        A robot whose wheels lag moves as one whose wheels obey at once, so much later.
        """
        best = int(self._misfits.argmin())
        return round(self._lags[best] * NANOSECONDS) if self._first else 0, self._wheels[best]

    @property
    def possible(self) -> list[tuple[float, Array]]:
        """Lags to reckon with [s], each with the speeds of the wheels by now [rad/s].

        The longest one possible and two shorter ones; no lag at all needs not be among them.
        """
        if self._lags[-1] == 0.0:
            return []
        last = self._last
        first = self._first - 1 if self._first else max((last + 1) // 3 - 1, 0)
        chosen = sorted({first, (first + last + 1) // 2, last})
        return [(self._lags[k], self._wheels[k]) for k in chosen]

    def advance(self, stamp: int, command: Array, robot: Robot) -> None:
        """Let the wheels follow a command until an instant.

        Args:
            stamp: The instant [ns].
            command: Since the one before, shape ``(r,)``.
            robot: Kinematics.
        """
        held, self._at = (stamp - self._at) / NANOSECONDS, stamp
        if held <= 0.0 or self._lags[-1] == 0.0:
            return
        commands, durations = command[None], np.array([held])
        for k, lag in enumerate(self._lags):
            path = with_lag(self._wheels[k], commands, durations, lag, _SLICES)
            self._poses[k] = robot.roll_out(self._poses[k], *path)[-1]

    def see(self, pose: Array, half_track: float) -> None:
        """Compare where each lag leads with where the robot is.

        Args:
            pose: Shape ``(3,)`` [m, m, rad].
            half_track: What an error of the heading counts for [m/rad].
        """
        if self._lags[-1] == 0.0:
            return
        if self._has_begun:
            turned = [math.remainder(each, math.tau) for each in (self._poses[:, 2] - pose[2])]
            self._misfits += (self._poses[:, 0] - pose[0]) ** 2 + (self._poses[:, 1] - pose[1]) ** 2
            self._misfits += (half_track * np.array(turned)) ** 2
            self._periods += 1
            least = float(self._misfits.min())
            allowed = _DEVIATIONS**2 * max(least / self._periods, _LEAST_ERROR**2)
            possible = np.flatnonzero(self._misfits - least <= allowed)
            # What lies between two that are tried is possible with either.
            self._first = int(possible[0])
            self._last = min(int(possible[-1]) + 1, _COUNT - 1)
        self._poses[:], self._has_begun = pose, True
