"""Discs that move at constant velocity, and of which ever less is known: what has been seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.compiled import allocation_free
from cmpsp_ros.robot.arcs import arc_from
from cmpsp_ros.robot.between_samples import (
    TwistLimits,
    at_ends,
    outside_moving,
    outside_moving_known,
)
from cmpsp_ros.robot.shape_functions import sweep_moving

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

X, Y, VELOCITY_X, VELOCITY_Y, RADIUS = range(5)
"""Columns of `MovingDiscs.states`."""


@dataclass(frozen=True)
class MovingDiscs:
    """Discs at an instant, with what is foreseen of them.

    Attributes:
        names: What messages call them.
        states: Centre, velocity and radius of each, shape ``(M, 5)`` [m, m, m/s, m/s, m].
        growth: Of all radii with time: of the uncertainty where the discs will be [m/s].
        slots: Which rows of a plan's constraints each has, -1 for none, shape ``(M,)``.
    """

    names: tuple[str, ...]
    states: Array
    growth: float
    slots: Indices

    def __len__(self) -> int:
        """How many there are."""
        return len(self.names)

    def after(self, seconds: float) -> MovingDiscs:
        """The same some time later, or earlier."""
        if not len(self) or seconds == 0.0:
            return self
        states = self.states.copy()
        states[:, :2] += seconds * states[:, 2:4]
        states[:, RADIUS] += seconds * self.growth
        return replace(self, states=states)

    def grown(self, distance: float) -> MovingDiscs:
        """The same with greater radii [m]."""
        if not len(self) or distance == 0.0:
            return self
        states = self.states.copy()
        states[:, RADIUS] += distance
        return replace(self, states=states)

    def clearance(self, point: Array) -> Array:
        """Distance of a point (x, y) from each at this instant, negative within; ``(M,)`` [m]."""
        away = point[:2] - self.states[:, :2]
        clear: Array = np.hypot(away[:, 0], away[:, 1]) - self.states[:, RADIUS]
        return clear

    def at_times(self, times: Array) -> tuple[Array, Array]:
        """Where they will be.

        Args:
            times: From now on, shape ``(K,)`` [s].

        Returns:
            Centres, shape ``(K, M, 2)``, and radii, shape ``(K, M)`` [m].
        """
        states = self.states
        centers = states[:, :2] + times[:, None, None] * states[:, 2:4]
        return centers, states[:, RADIUS] + self.growth * times[:, None]

    def for_samples(
        self, times: Array, limits: TwistLimits | None, period: float, start: Array
    ) -> tuple[Array, Array]:
        """Where they will be at the samples of a plan, and what to keep from their centres there.

        With that any path between two samples is clear. Where the robot cannot be by then a disc
        asks for nothing: its radius there is ``-inf``.

        Args:
            times: Of the samples, shape ``(N + 1,)`` [s].
            limits: What the robot can drive; None where only the samples count.
            period: Longest time between two samples [s].
            start: Where the robot is at first, shape ``(2,)`` or more [m].

        Returns:
            As from `at_times`, for each sample.
        """
        centers, radii = self.at_times(times)
        if limits is None:
            return centers, radii
        radii = outside_moving(_until_next(radii), self._speeds(), limits, period)
        away = centers - start[:2]
        nearest = np.hypot(away[..., 0], away[..., 1]) - limits.speed * times[:, None]
        radii[nearest > radii] = -np.inf
        return centers, radii

    def for_samples_of(self, times: Array, twists: Array, period: float) -> tuple[Array, Array]:
        """Like `for_samples`, for the arcs of one plan.

        Args:
            times: Of the samples, shape ``(N + 1,)`` [s].
            twists: Speed and turn rate between samples, shape ``(N, 2)`` [m/s, rad/s].
            period: Longest time between two samples [s].
        """
        centers, radii = self.at_times(times)
        of_arcs = outside_moving_known(radii[1:], self._speeds(), twists, period)
        return centers, at_ends(np.maximum, of_arcs)

    def along(self, poses: Array, twists: Array, durations: Array, times: Array) -> Array:
        """Least clearance of arcs that are driven while they move.

        Args:
            poses: Pose at the start of each arc, shape ``(K, 3)`` [m, m, rad].
            twists: Speed and turn rate along it, shape ``(K, 2)`` [m/s, rad/s].
            durations: Shape ``(K,)`` [s].
            times: When each begins, from now on, shape ``(K,)`` [s].

        Returns:
            From each disc, never more than it is; shape ``(K, M)`` [m].
        """
        clearance = np.empty((len(poses), len(self)))
        arrays = (np.ascontiguousarray(each) for each in (poses, twists, durations, times))
        _along(clearance, self.states, self.growth, *arrays)
        return clearance

    def _speeds(self) -> Array:
        speeds: Array = np.hypot(self.states[:, VELOCITY_X], self.states[:, VELOCITY_Y])
        return speeds


NOTHING_MOVES = MovingDiscs((), np.empty((0, 5)), 0.0, np.empty(0, np.int64))
"""No discs."""


def _until_next(radii: Array) -> Array:
    """Radii of discs that grow, as great as they become until the sample after."""
    return np.vstack([radii[1:], radii[-1:]])


@allocation_free
def _along(
    clearance: Array,
    states: Array,
    growth: float,
    poses: Array,
    twists: Array,
    durations: Array,
    times: Array,
) -> None:
    for k in range(durations.shape[0]):
        length, turn = twists[k, 0] * durations[k], twists[k, 1] * durations[k]
        arc = arc_from(poses[k, 0], poses[k, 1], poses[k, 2], length, turn)
        for j in range(states.shape[0]):
            u, v = states[j, VELOCITY_X], states[j, VELOCITY_Y]
            x, y = states[j, X] + times[k] * u, states[j, Y] + times[k] * v
            least = sweep_moving(arc, durations[k], x, y, u, v, growth, np.inf)
            clearance[k, j] = least - (states[j, RADIUS] + growth * times[k])
