"""A path as its distance from the centre of a circular road, and wheel speeds that follow it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.planning.initial_trajectories import (
    SHORTEST_LOOKAHEAD,
    largest_turn,
    steer,
    wrapped,
)
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.mpsp.jit.compiled import allocation_free

Array = NDArray[np.float64]

# Length over which a path that was pushed aside comes back to the centre line [m].
_RETURN = 1.5
_SWEEPS = 40
_RELAXATION = 1.6

_LOOKAHEAD = 0.35


def elastic_band(
    low: Array, high: Array, ends: tuple[float, float], middle: float, step: float
) -> Array:
    """Smooth paths between bounds, near the centre line where nothing pushes them aside.

    They are elastic bands that the centre line attracts, found by projected over-relaxation.

    Args:
        low: Bounds at stations along the arc, one row a path, shape ``(W, K)`` [m].
        high: The same.
        ends: Where all of them begin and end [m].
        middle: Radius of the centre line [m].
        step: Angle from one station to the next [rad].

    Returns:
        Distances from the road's centre, shape ``(W, K)`` [m].
    """
    radii: Array = np.clip(np.full_like(low, middle), low, high)
    radii[:, 0], radii[:, -1] = ends
    _relax(radii, low, high, middle, (step * middle / _RETURN) ** 2)
    return radii


def shortest_path(low: Array, high: Array, ends: tuple[float, float], step: float) -> Array:
    """Shortest paths between bounds, as of a taut string.

    Where it is free ``r'' = r``, to first order in its angle to the road's direction.

    Args:
        low: Bounds at stations along the arc, one row a path, shape ``(W, K)`` [m].
        high: The same.
        ends: Where all of them begin and end [m].
        step: Angle from one station to the next [rad].

    Returns:
        Distances from the road's centre, shape ``(W, K)`` [m].
    """
    radii = low.copy()
    radii[:, 0], radii[:, -1] = ends
    _relax(radii, low, high, 0.0, step**2)
    return radii


@allocation_free
def _relax(radii: Array, low: Array, high: Array, middle: float, pull: float) -> None:
    for path in range(radii.shape[0]):
        for sweep in range(2 * _SWEEPS):
            for k in range(1 + sweep % 2, radii.shape[1] - 1, 2):
                here = radii[path, k]
                wanted = radii[path, k - 1] + radii[path, k + 1] + pull * middle
                moved = here + _RELAXATION * (wanted / (2.0 + pull) - here)
                radii[path, k] = min(max(moved, low[path, k]), high[path, k])


def follow_profile(
    settings: GuidanceSettings,
    start: PlanStart,
    durations: Array,
    begin: float,
    total: float,
    profile: Array,
) -> Array:
    """Pursuit of a point ahead on a path, so paced as to be at its end in time.

    Args:
        settings: All settings of the guidance law.
        start: Where to begin.
        durations: Length of every step, shape ``(N,)`` [s].
        begin: Bearing of the pose from the road's centre [rad].
        total: From there to the end of the path [rad], negative clockwise.
        profile: Distance from the road's centre at stations evenly along it, shape ``(K,)`` [m].

    Returns:
        Wheel speeds ``(N + 1, 2)`` [rad/s].
    """
    robot, (center_x, center_y) = start.robot, settings.annulus.center
    step = abs(total) / (len(profile) - 1)
    left = np.zeros(len(profile))
    left[:-1] = np.cumsum(lengths(profile, step)[::-1])[::-1]
    path = _Path(center_x, center_y, begin, math.copysign(1.0, total), step, profile, left)
    controls, poses = np.empty((len(durations) + 1, 2)), np.empty((len(durations) + 1, 3))
    poses[0] = start.pose
    _follow(
        controls,
        poses,
        durations,
        path,
        robot.wheel_radius,
        robot.half_track,
        robot.max_wheel_speed,
        largest_turn(settings),
    )
    return controls


def lengths(profile: Array, step: float) -> Array:
    """Lengths of paths between stations [m].

    Args:
        profile: Distances from the road's centre, shape ``(..., K)`` [m].
        step: Angle from one station to the next [rad].

    Returns:
        Shape ``(..., K - 1)``.
    """
    along = (profile[..., 1:] + profile[..., :-1]) / 2.0 * step
    pieces: Array = np.hypot(np.diff(profile), along)
    return pieces


class _Path(NamedTuple):
    """A path around the road's centre.

    Attributes:
        center_x: Of the road [m].
        center_y: Of the road [m].
        begin: Bearing at which it begins [rad].
        side: 1 anticlockwise, -1 clockwise.
        step: Angle from one station to the next [rad].
        radii: At the stations, shape ``(K,)`` [m].
        left: Length still to go from each, shape ``(K,)`` [m].
    """

    center_x: float
    center_y: float
    begin: float
    side: float
    step: float
    radii: Array
    left: Array


@allocation_free
def _follow(
    controls: Array,
    poses: Array,
    durations: Array,
    path: _Path,
    wheel_radius: float,
    half_track: float,
    max_wheel_speed: float,
    max_turn: float,
) -> None:
    """Fill the controls, step by step along the poses that they lead to."""
    steps, end = durations.shape[0], path.step * (path.radii.shape[0] - 1)
    turned, bearing, left = 0.0, path.begin, 0.0
    for k in range(steps):
        left += durations[k]
    for k in range(steps):
        speed = min(
            max(_at(path.left, path.step, turned), 0.0) / left, max_wheel_speed * wheel_radius
        )
        ahead = max(_LOOKAHEAD * speed, SHORTEST_LOOKAHEAD)
        at = turned + ahead / max(_at(path.radii, path.step, turned), SHORTEST_LOOKAHEAD)
        radius, target = _at(path.radii, path.step, at), path.begin + path.side * min(at, end)
        steer(
            controls,
            poses,
            k,
            durations[k],
            path.center_x + radius * math.cos(target) - poses[k, 0],
            path.center_y + radius * math.sin(target) - poses[k, 1],
            speed,
            wheel_radius,
            half_track,
            max_wheel_speed,
            max_turn,
        )
        now = math.atan2(poses[k + 1, 1] - path.center_y, poses[k + 1, 0] - path.center_x)
        turned += path.side * wrapped(now - bearing)
        bearing, left = now, max(left - durations[k], 1e-9)
    controls[steps, 0], controls[steps, 1] = controls[steps - 1, 0], controls[steps - 1, 1]


@allocation_free
def _at(table: Array, step: float, turned: float) -> float:
    """What a table has at an angle, between its stations too."""
    place = min(max(turned / step, 0.0), table.shape[0] - 1.0)
    k = min(int(place), table.shape[0] - 2)
    between: float = table[k] + (place - k) * (table[k + 1] - table[k])
    return between
