"""A path as its lateral positions at the stations of a road, and wheel speeds that follow it."""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.planning.homotopy.road_frame import RoadFrame, locate, point_at, stretch_at
from cmpsp_ros.guidance.planning.initial_trajectories import (
    SHORTEST_LOOKAHEAD,
    guess_arrays,
    largest_turn,
    steer,
    wrapped,
)
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import DifferentialDrive, Kinematics, drive
from cmpsp_ros.robots import steer as steer_by

# Length over which a path that was pushed aside comes back to the centre line [m].
_RETURN = 1.5
_SWEEPS = 40
_RELAXATION = 1.6

_LOOKAHEAD = 0.35


def elastic_band(frame: RoadFrame, low: Array, high: Array, ends: tuple[float, float]) -> Array:
    """Smooth paths between bounds, near the centre line where nothing pushes them aside.

    They are elastic bands that the centre line attracts, found by projected over-relaxation.

    Args:
        frame: Road coordinates.
        low: Bounds at its stations, one row a path, shape ``(W, K)`` [m].
        high: The same.
        ends: Where all of them begin and end [m].

    Returns:
        Lateral positions, shape ``(W, K)`` [m].
    """
    profiles: Array = np.clip(np.full_like(low, frame.middle), low, high)
    profiles[:, 0], profiles[:, -1] = ends
    pull = np.full(len(frame.stations), (frame.spacing / _RETURN) ** 2)
    _relax(profiles, low, high, pull, pull * frame.middle)
    return profiles


def shortest_path(frame: RoadFrame, low: Array, high: Array, ends: tuple[float, float]) -> Array:
    """Shortest paths between bounds, as of a taut string.

    To first order in its angle to the road's direction a free one has ``r'' = r`` in polar
    coordinates, and ``e'' = c^2 e - c`` beside a line of curvature ``c``. Arguments and result as
    in `elastic_band`.
    """
    profiles = low.copy() if frame.polar else np.clip(np.zeros_like(low), low, high)
    profiles[:, 0], profiles[:, -1] = ends
    if frame.polar:
        pull, drift = np.full(len(frame.stations), frame.step**2), np.zeros(len(frame.stations))
    else:
        pull, drift = (frame.curvature * frame.step) ** 2, frame.curvature * frame.step**2
    _relax(profiles, low, high, pull, drift)
    return profiles


@allocation_free
def _relax(profiles: Array, low: Array, high: Array, pull: Array, drift: Array) -> None:
    for path in range(profiles.shape[0]):
        for sweep in range(2 * _SWEEPS):
            for k in range(1 + sweep % 2, profiles.shape[1] - 1, 2):
                here = profiles[path, k]
                wanted = profiles[path, k - 1] + profiles[path, k + 1] + drift[k]
                moved = here + _RELAXATION * (wanted / (2.0 + pull[k]) - here)
                profiles[path, k] = min(max(moved, low[path, k]), high[path, k])


def follow_profile(
    settings: LawSettings,
    start: PlanStart,
    durations: Array,
    frame: RoadFrame,
    profile: Array,
    free_turn_rate: float = 0.0,
) -> Array:
    """Pursuit of a point ahead on a path, so paced as to be at its end in time.

    Where the change of two wheels is limited none changes faster, and a robot at rest turns on the
    spot first: while it sets out it cannot turn.

    Args:
        settings: All settings of the guidance law.
        start: Where to begin.
        durations: Length of every step, shape ``(N,)`` [s].
        frame: Road coordinates.
        profile: Lateral positions at its stations, shape ``(K,)`` [m].
        free_turn_rate: As in `steer` [rad/s].

    Returns:
        Controls ``(N + 1, r)``.
    """
    left = np.zeros(len(profile))
    left[:-1] = np.cumsum(lengths(frame, profile)[::-1])[::-1]
    change = turn_change = math.inf
    if isinstance(start.robot, DifferentialDrive):
        change = settings.max_wheel_change
        turn_change = change * start.robot.wheel_radius / start.robot.half_track
    turns_first = change < math.inf and not start.previous_control.any()
    controls, poses = guess_arrays(start, durations)
    _follow(
        controls,
        poses,
        durations,
        frame,
        np.ascontiguousarray(profile),
        left,
        start.robot.kinematics,
        largest_turn(settings),
        free_turn_rate,
        np.ascontiguousarray(start.previous_control, dtype=np.float64),
        float(change),
        float(turn_change),
        _SPOT if turns_first else math.inf,
    )
    return controls


def lengths(frame: RoadFrame, profile: Array) -> Array:
    """Lengths of paths between stations [m].

    Args:
        frame: Road coordinates.
        profile: Lateral positions, shape ``(..., K)`` [m].

    Returns:
        Shape ``(..., K - 1)``.
    """
    along = (profile[..., 1:] + profile[..., :-1]) / 2.0
    if not frame.polar:
        along = 1.0 - (frame.curvature[1:] + frame.curvature[:-1]) / 2.0 * along
    pieces: Array = np.hypot(np.diff(profile), along * frame.step)
    return pieces


_SPOT = 0.5
"""Angle up to which a robot at rest turns on the spot [rad]."""


@allocation_free
def _follow(
    controls: Array,
    poses: Array,
    durations: Array,
    frame: RoadFrame,
    profile: Array,
    left_from: Array,
    robot: Kinematics,
    max_turn: float,
    free_turn_rate: float,
    previous: Array,
    max_change: float,
    max_turn_change: float,
    spot: float,
) -> None:
    """Fill the controls, step by step along the poses that they lead to."""
    steps, end = durations.shape[0], frame.step * (profile.shape[0] - 1)
    at, _, bearing = locate(frame, poses[0, 0], poses[0, 1], 0.0, frame.begin)
    left = 0.0
    for k in range(steps):
        left += durations[k]
    for k in range(steps):
        speed = min(max(_interpolate(left_from, frame.step, at), 0.0) / left, robot.max_speed)
        ahead = max(_LOOKAHEAD * speed, SHORTEST_LOOKAHEAD)
        stretch = stretch_at(frame, at, _interpolate(profile, frame.step, at))
        there = at + ahead / max(stretch, SHORTEST_LOOKAHEAD)
        lateral = _interpolate(profile, frame.step, there)
        x, y = point_at(frame, min(there, end), lateral)
        angle = wrapped(math.atan2(y - poses[k, 1], x - poses[k, 0]) - poses[k, 2])
        if abs(angle) <= spot:
            spot = math.inf
            steer(
                controls,
                poses,
                k,
                durations[k],
                x - poses[k, 0],
                y - poses[k, 1],
                speed,
                robot,
                max_turn,
                free_turn_rate,
            )
        else:
            # The wheels brake as they have set out: by half of the angle each.
            most = math.sqrt(max_turn_change * durations[k] * abs(angle))
            turn = math.copysign(min(abs(angle), max_turn, most), angle)
            steer_by(controls, k, 0.0, 0.0, turn / durations[k], 0.0, robot)
        if max_change < math.inf:
            for side in range(2):
                before = previous[side] if k == 0 else controls[k - 1, side]
                within = max(controls[k, side], before - max_change)
                controls[k, side] = min(within, before + max_change)
            drive(poses, controls, k, durations[k], robot)
        at, _, bearing = locate(frame, poses[k + 1, 0], poses[k + 1, 1], at, bearing)
        left = max(left - durations[k], 1e-9)
    for a in range(controls.shape[1]):
        controls[steps, a] = controls[steps - 1, a]


@allocation_free
def _interpolate(table: Array, step: float, at: float) -> float:
    """What a table has at a station, between two of them too."""
    place = min(max(at / step, 0.0), table.shape[0] - 1.0)
    k = min(int(place), table.shape[0] - 2)
    between: float = table[k] + (place - k) * (table[k + 1] - table[k])
    return between
