"""A way along the road as its distance from the road's centre, and wheel speeds that follow it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import GuidanceSettings

Array = NDArray[np.float64]

# Over which a way that was pushed aside comes back to the centre line [m].
_RETURN = 1.5
_SWEEPS = 40
_RELAXATION = 1.6

_LOOKAHEAD = 0.35
_SHORTEST_LOOKAHEAD = 0.3


def relax(low: Array, high: Array, ends: tuple[float, float], middle: float, step: float) -> Array:
    """Smooth ways between bounds, near the centre line where nothing pushes them aside.

    They are elastic bands that the centre line attracts, found by projected over-relaxation.

    Args:
        low: Bounds at stations along the arc, one row a way, shape ``(W, K)`` [m].
        high: The same.
        ends: Where all of them begin and end [m].
        middle: Radius of the centre line [m].
        step: Angle from one station to the next [rad].

    Returns:
        Distances from the road's centre, shape ``(W, K)`` [m].
    """
    radii: Array = np.clip(np.full_like(low, middle), low, high)
    radii[:, 0], radii[:, -1] = ends
    pull = (step * middle / _RETURN) ** 2
    for _ in range(_SWEEPS):
        for first in (1, 2):
            inside = slice(first, low.shape[1] - 1, 2)
            before = radii[:, first - 1 : low.shape[1] - 2 : 2]
            after = radii[:, first + 1 : low.shape[1] : 2]
            wanted = (before + after + pull * middle) / (2.0 + pull)
            moved = radii[:, inside] + _RELAXATION * (wanted - radii[:, inside])
            radii[:, inside] = np.minimum(np.maximum(moved, low[:, inside]), high[:, inside])
    return radii


def follow(
    settings: GuidanceSettings,
    pose: Array,
    durations: Array,
    begin: float,
    total: float,
    profile: Array,
) -> Array:
    """Pursuit of a point ahead on a way, so paced as to be at its end in time.

    Args:
        settings: All settings of the guidance law.
        pose: Where to begin, shape ``(3,)`` [m, m, rad].
        durations: Length of every step, shape ``(N,)`` [s].
        begin: Bearing of the pose from the road's centre [rad].
        total: From there to the end of the way [rad], negative clockwise.
        profile: Distance from the road's centre at stations evenly along it, shape ``(K,)`` [m].

    Returns:
        Wheel speeds ``(N + 1, 2)`` [rad/s].
    """
    robot, (center_x, center_y) = settings.robot, settings.road.center
    step, side = abs(total) / (len(profile) - 1), math.copysign(1.0, total)
    way = _Way(profile, step)
    most_turn = settings.solver.heading_trust_region or math.pi / 2.0
    x, y, heading = (float(value) for value in pose)
    turned, bearing, left = 0.0, begin, float(durations.sum())
    controls = np.empty((len(durations) + 1, 2))
    for k, duration in enumerate(durations.tolist()):
        speed = min(max(way.length_from(turned), 0.0) / left, robot.max_speed)
        ahead = max(_LOOKAHEAD * speed, _SHORTEST_LOOKAHEAD)
        at = turned + ahead / max(way.radius_at(turned), _SHORTEST_LOOKAHEAD)
        radius, target = way.radius_at(at), begin + side * min(at, abs(total))
        off_x = center_x + radius * math.cos(target) - x
        off_y = center_y + radius * math.sin(target) - y
        turn = _pursue(off_x, off_y, heading, speed) * duration
        turn = min(max(turn, -most_turn), most_turn)
        rim = turn / duration * robot.half_track
        right, slow = (speed + rim) / robot.wheel_radius, (speed - rim) / robot.wheel_radius
        # Both wheels are slowed alike where one would exceed its limit.
        slowed = min(1.0, robot.max_wheel_speed / max(abs(right), abs(slow), 1e-12))
        controls[k] = right * slowed, slow * slowed
        chord, turn = speed * slowed * duration, turn * slowed
        chord *= math.sin(turn / 2.0) / (turn / 2.0) if abs(turn) > 1e-6 else 1.0
        x += chord * math.cos(heading + turn / 2.0)
        y += chord * math.sin(heading + turn / 2.0)
        heading += turn
        now = math.atan2(y - center_y, x - center_x)
        turned += side * math.remainder(now - bearing, math.tau)
        bearing, left = now, left - duration
        left = max(left, 1e-9)
    controls[-1] = controls[-2]
    return controls


class _Way:
    """Radius and length still to go by the angle turned, from a table."""

    def __init__(self, profile: Array, step: float) -> None:
        pieces = np.hypot(np.diff(profile), (profile[1:] + profile[:-1]) / 2.0 * step)
        self._radii: list[float] = profile.tolist()
        self._left: list[float] = [*np.cumsum(pieces[::-1])[::-1].tolist(), 0.0]
        self._step = step

    def radius_at(self, turned: float) -> float:
        return self._look_up(self._radii, turned)

    def length_from(self, turned: float) -> float:
        return self._look_up(self._left, turned)

    def _look_up(self, table: list[float], turned: float) -> float:
        place = min(max(turned / self._step, 0.0), len(table) - 1.0)
        k = min(int(place), len(table) - 2)
        return table[k] + (place - k) * (table[k + 1] - table[k])


def _pursue(offset_x: float, offset_y: float, heading: float, speed: float) -> float:
    """Turn rate [rad/s] of the arc from the pose through a target at an offset [m]."""
    distance = max(math.hypot(offset_x, offset_y), _SHORTEST_LOOKAHEAD)
    angle = math.remainder(math.atan2(offset_y, offset_x) - heading, math.tau)
    bend = math.sin(angle) if abs(angle) < math.pi / 2.0 else math.copysign(1.0, angle)
    return 2.0 * speed * bend / distance
