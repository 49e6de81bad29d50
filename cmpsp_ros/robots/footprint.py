"""Footprints: a disc, or a polygon whose outline a few discs cover."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.robots.motion.arcs import speeds_and_turns, with_side
from cmpsp_ros.robots.robot import Robot, TwistLimits

Point = tuple[float, float]
Bodies = Sequence[tuple[Array, float]]
"""Unions of discs: their centres in the robot's frame, ``(D, 2)``, and their radius [m]."""

_MOST: Final = 5
_TOLERANCE: Final = 0.125  # part of half the width by which discs may reach beyond the side
_WIDE: Final = 2.0  # width, in lengths, from which the discs stand side by side
_ROUNDING: Final = 1e-9
_POINTS: Final = 400  # number of points of an outline, about
_FINEST: Final = 10  # most slices of the longer side, where discs may not reach far beyond


@dataclass(frozen=True)
class Footprint:
    """A polygon, and centres of equal discs that cover it, all in the robot's frame [m].

    Without corners, which go anticlockwise, it is one disc about the reference point.
    """

    corners: tuple[Point, ...] = ()
    centers: tuple[Point, ...] = ((0.0, 0.0),)

    @cached_property
    def discs(self) -> Array:
        """Centres of the discs, shape ``(D, 2)`` [m]."""
        return np.array(self.centers)

    @cached_property
    def reach(self) -> float:
        """Greatest distance of a disc's centre from the reference point [m]."""
        return float(np.hypot(*self.discs.T).max())

    @cached_property
    def inscribed(self) -> float:
        """Radius of the largest disc about the reference point inside the polygon [m]."""
        return float(_from_outline(np.array(self.corners), np.zeros((1, 2)))[0])

    @cached_property
    def outline(self) -> tuple[Array, float]:
        """Points around the polygon ``(P, 2)``, and the radius of discs that cover it [m]."""
        corners = np.array(self.corners)
        sides = np.roll(corners, -1, axis=0) - corners
        lengths = np.hypot(*sides.T)
        counts = np.ceil(_POINTS * lengths / lengths.sum()).astype(int)
        parts = [
            corner + np.linspace(0.0, 1.0, count, endpoint=False)[:, None] * side
            for corner, side, count in zip(corners, sides, counts, strict=True)
        ]
        return np.vstack(parts), (0.5 + _ROUNDING) * float((lengths / counts).max())

    def at(self, pose: Array) -> Array:
        """The polygon at a pose ``(x, y, heading)`` [m, m, rad], shape ``(C, 2)`` [m]."""
        return placed(np.array(self.corners), pose)

    def twist_limits(self, robot: Robot) -> TwistLimits:
        """Twists of the centres of all discs: one beside the reference point is faster in turns.

        Their speed is convex in the turn rate; ValueError without a wheel-speed limit.
        """
        limits = robot.twist_limits()
        if self.reach == 0.0:
            return limits
        turn_rate = limits.turn_rate
        slowest = limits.speed - limits.half_track * turn_rate
        ahead, left = turn_rate * np.abs(self.discs.T)
        fastest = np.hypot(slowest + left, ahead)
        if robot.twist_parts > 2:
            fastest = slowest + np.hypot(left, ahead)
        half_track = (limits.speed - float(fastest.max())) / turn_rate
        return TwistLimits(limits.speed, turn_rate, half_track)

    def speeds_and_turns(self, twists: Array) -> Array:
        """Speed of the fastest disc, and turn rate, of twists of either form, ``(N, 2)``."""
        if self.reach == 0.0:
            return speeds_and_turns(twists)
        forward, left, turning = with_side(twists).T[..., None]
        ahead, aside = self.discs.T
        speeds = np.hypot(forward - turning * aside, left + turning * ahead)
        return np.column_stack([speeds.max(axis=1), turning])


def contains(corners: Array, points: Array) -> BoolArray:
    """Mask of the points ``(..., 2)`` in a polygon: their rays cross an odd number of sides."""
    x, y = np.moveaxis(corners - points[..., None, :], -1, 0)
    to_x, to_y = np.roll((x, y), -1, axis=-1)
    crosses = ((y > 0.0) != (to_y > 0.0)) & ((x * to_y > y * to_x) == (to_y > y))
    return np.asarray(crosses.sum(axis=-1) % 2 == 1)


def placed(points: Array, pose: Array) -> Array:
    """Points of the robot's frame at a pose ``(x, y, heading)`` [m, m, rad], ``(C, 2)`` [m]."""
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return np.asarray(pose[:2] + points @ np.array([[cosine, sine], [-sine, cosine]]))


def covered(corners: Sequence[Point], excess: float = 0.0) -> tuple[Footprint, float]:
    """A polygon covered by as few equal discs in a row as are little wider than it; their radius.

    The row lies along the robot: a gap is driven through in that direction. With an `excess` by
    which discs may reach beyond [m], rows side by side cover the outline; ValueError if too many.
    """
    points = np.array(corners, dtype=float)
    after = np.roll(points, -1, axis=0)
    if (points[:, 0] * after[:, 1] - points[:, 1] * after[:, 0]).sum() < 0.0:
        points = points[::-1]
    if excess > 0.0:
        return _finely_covered(points, excess)
    low, high = points.min(axis=0), points.max(axis=0)
    length, width = (high - low).tolist()
    axis = int(width > _WIDE * length)
    half, centers, radius = (width, length)[axis] / 2.0, np.empty((0, 2)), math.inf
    for count in range(1, _MOST + 1):
        cuts = np.linspace(low[axis], high[axis], count + 1).tolist()
        slices = [_slice(points, axis, begin, end) for begin, end in pairwise(cuts)]
        centers = np.array([(each.min(axis=0) + each.max(axis=0)) / 2.0 for each in slices])
        away = [np.hypot(*(part - center).T) for part, center in zip(slices, centers, strict=True)]
        radius = (1.0 + _ROUNDING) * float(max(each.max() for each in away))
        if radius <= (1.0 + _TOLERANCE) * half:
            break
    return _footprint(points, centers), radius


def _finely_covered(points: Array, excess: float) -> tuple[Footprint, float]:
    """An anticlockwise polygon whose outline is covered by discs that reach little beyond it."""
    low, high = points.min(axis=0), points.max(axis=0)
    beyond = math.inf
    for count in range(1, _FINEST + 1):
        counts = np.ceil(count * (high - low) / (high - low).max()).astype(int)
        cuts = [np.linspace(*ends) for ends in zip(low, high, counts + 1, strict=True)]
        cells = [
            cell
            for begin, end in pairwise(cuts[0].tolist())
            for below, above in pairwise(cuts[1].tolist())
            if len(cell := _slice(_slice(points, 0, begin, end), 1, below, above))
        ]
        centers = np.array([(each.min(axis=0) + each.max(axis=0)) / 2.0 for each in cells])
        away = [np.hypot(*(cell - center).T) for cell, center in zip(cells, centers, strict=True)]
        radius = (1.0 + _ROUNDING) * float(max(each.max() for each in away))
        inside = _from_outline(points, centers)
        outer = float(np.where(contains(points, centers), -inside, inside).max())
        beyond = min(beyond, radius + outer)
        if radius + outer <= excess:
            return _footprint(points, centers[inside <= radius]), radius
    raise ValueError(f'{beyond:.2g} m or more')


def _footprint(points: Array, centers: Array) -> Footprint:
    return Footprint(*(tuple(map(tuple, each.tolist())) for each in (points, centers)))


def _from_outline(corners: Array, points: Array) -> Array:
    """Distance of points ``(K, 2)`` from the outline of a polygon, shape ``(K,)`` [m]."""
    along = np.roll(corners, -1, axis=0) - corners
    away = points[:, None] - corners
    part = (away * along).sum(axis=-1) / np.square(along).sum(axis=1)
    away -= np.clip(part, 0.0, 1.0)[..., None] * along
    return np.asarray(np.hypot(away[..., 0], away[..., 1]).min(axis=1))


def _slice(points: Array, axis: int, begin: float, end: float) -> Array:
    """Points whose hull is the part of a polygon between two lines across an axis."""
    found = [each for each in points if begin <= each[axis] <= end]
    for a, b in zip(points, np.roll(points, -1, axis=0), strict=True):
        for cut in (begin, end):
            if (a[axis] - cut) * (b[axis] - cut) < 0.0:
                crossing = a + (cut - a[axis]) / (b[axis] - a[axis]) * (b - a)
                crossing[axis] = cut
                found.append(crossing)
    return np.array(found)
