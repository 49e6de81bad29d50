"""Moving discs, seen or announced, with uncertainty that grows with time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.robots.motion import REFERENCE_POINT, Arc, arc_of_point, arc_part, arc_under
from cmpsp_ros.world.inter_sample_margin import at_ends, outside_moving, outside_moving_known
from cmpsp_ros.world.obstacles.shape_functions import pieces_for

# Columns of `MovingDiscs.states` and `MovingDiscs.legs`.
_PLACE, _VELOCITY, _RADIUS, _GROWTH, _BEND = slice(0, 2), slice(2, 4), 4, 5, 6
_COLUMNS = 7


@dataclass(frozen=True)
class MovingDiscs:
    """Discs at an instant that go on at constant velocity, or by known ways.

    A way goes straight from place to place; they stand before the first and after the last.
    """

    names: tuple[str, ...]  # names in messages
    # centre, velocity and radius of each, growth of the radius and its acceleration, ``(M, 7)``
    # [m, m, m/s, m/s, m, m/s, m/s^2]: the radius is that of all places where the disc may be
    states: Array
    slots: IntArray  # index of each one's rows of a plan's constraints, -1 for none, shape ``(M,)``
    # times from now on and places (t, x, y) by the index of a disc, ``(J, 3)`` [s, m, m] each;
    # the velocity in `states` does not count there
    ways: Mapping[int, Array] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.names)

    def after(self, seconds: float) -> MovingDiscs:
        """The same some time later, or earlier."""
        if not len(self) or seconds == 0.0:
            return self
        states = self.states.copy()
        centers, radii = self.at_times(np.array([seconds]))
        states[:, _PLACE], states[:, _RADIUS] = centers[0], radii[0]
        states[:, _GROWTH] += seconds * states[:, _BEND]
        ways = {index: way - np.array([seconds, 0.0, 0.0]) for index, way in self.ways.items()}
        return MovingDiscs(self.names, states, self.slots, ways)

    def grown(self, distance: float) -> MovingDiscs:
        """The same with greater radii [m]."""
        if not len(self) or distance == 0.0:
            return self
        states = self.states.copy()
        states[:, _RADIUS] += distance
        return MovingDiscs(self.names, states, self.slots, self.ways)

    def at_rest(self) -> MovingDiscs:
        """The same where they are now, for ever."""
        states = self.states.copy()
        states[:, _VELOCITY], states[:, _GROWTH:] = 0.0, 0.0
        return MovingDiscs(self.names, states, self.slots)

    def within(self, point: Array, reach: float, seconds: float) -> IntArray:
        """Indices of those that may come as near to a point (x, y) as `reach` [m] in a time [s]."""
        states = self.states
        grown = states[:, _GROWTH] + 0.5 * seconds * states[:, _BEND]
        nearer = (np.hypot(states[:, 2], states[:, 3]) + grown) * seconds
        near = self.clearance(point) - nearer <= reach
        near[list(self.ways)] = True
        return np.flatnonzero(near)

    def chosen(self, index: IntArray) -> MovingDiscs:
        """Some of them, in the order of their indices ``(K,)``."""
        each = index.tolist()
        ways = {new: self.ways[old] for new, old in enumerate(each) if old in self.ways}
        names = tuple(self.names[old] for old in each)
        return MovingDiscs(names, self.states[index], self.slots[index], ways)

    def joined(self, other: MovingDiscs) -> MovingDiscs:
        """These and others, none of which has a way that is known."""
        states = np.vstack([self.states, other.states])
        slots = np.concatenate([self.slots, other.slots])
        return MovingDiscs((*self.names, *other.names), states, slots, self.ways)

    def clearance(self, points: Array) -> Array:
        """Distances ``(..., M)`` of points ``(..., 2)`` from each now, negative within [m]."""
        away = points[..., None, :2] - self.states[:, :2]
        return np.asarray(np.hypot(away[..., 0], away[..., 1]) - self.states[:, _RADIUS])

    def at_times(self, times: Array) -> tuple[Array, Array]:
        """Centres ``(K, M, 2)`` and radii ``(K, M)`` [m] at times from now on ``(K,)`` [s]."""
        states = self.states
        centers = states[:, _PLACE] + times[:, None, None] * states[:, _VELOCITY]
        for index, way in self.ways.items():
            centers[:, index] = _on(way, times)
        growth = states[:, _GROWTH] + 0.5 * times[:, None] * states[:, _BEND]
        return centers, states[:, _RADIUS] + growth * times[:, None]

    def legs(self, durations: Array) -> Array:
        """States ``(K, M, 7)`` at the beginnings of steps, with constant velocity and growth.

        A disc is greater by as much as its way strays from a straight line within a step.
        """
        if not len(self):
            return _NO_LEGS
        legs = np.empty((len(durations), len(self), _COLUMNS))
        _put_legs(legs, self.states, durations)
        times = np.concatenate([[0.0], np.cumsum(durations)]) if self.ways else durations
        for index, way in self.ways.items():
            places = _on(way, times)
            legs[:, index, _PLACE] = places[:-1]
            legs[:, index, _VELOCITY] = np.diff(places, axis=0) / durations[:, None]
            legs[:, index, _RADIUS] += _astray(way, times, places)
        return legs

    def tightened(
        self,
        times: Array,
        limits: TwistLimits | None,
        period: float,
        start: Array,
        reach: float = 0.0,
    ) -> tuple[Array, Array]:
        """Centres at samples and distances to keep there, so that the path between them is clear.

        Without limits of twists only samples are. Where the robot cannot be by then, its discs
        within reach [m] of the start, a radius is ``-inf``.
        """
        centers, radii = self.at_times(times)
        if limits is None:
            return centers, radii
        of_arcs = outside_moving(*self._between(times), limits, period)
        radii = at_ends(np.maximum, of_arcs)
        away = centers - start[:2]
        driven = limits.top_speed * times[:, None] + reach
        nearest = np.hypot(away[..., 0], away[..., 1]) - driven
        radii[nearest > radii] = -np.inf
        return centers, radii

    def for_samples_of(self, times: Array, twists: Array, period: float) -> tuple[Array, Array]:
        """Like `tightened`, for the arcs of one plan under twists ``(N, 2)`` [m/s, rad/s]."""
        centers, _ = self.at_times(times)
        of_arcs = outside_moving_known(*self._between(times), twists, period)
        return centers, at_ends(np.maximum, of_arcs)

    def along(
        self,
        poses: Array,
        twists: Array,
        durations: Array,
        times: Array,
        points: Array = REFERENCE_POINT,
    ) -> Array:
        """Least clearance ``(K, M)`` [m], or less, of arcs that are driven while they move.

        They are those of `FreeSpace.along`, one after the other, at times from now on [s]; of
        points the nearest counts.
        """
        clearance = np.empty((len(poses), len(self)))
        arrays = (np.ascontiguousarray(each) for each in (poses, twists, durations, times))
        put_clearance(clearance, points, self.on_arcs(times, durations), *arrays)
        return clearance

    def on_arcs(self, times: Array, durations: Array) -> Array:
        """States from which discs go straight on during each arc, ``(K, M, 7)`` or one for all."""
        if not self.ways:
            return self.states[None]
        states = np.tile(self.states, (len(times), 1, 1))
        instants = np.append(times, times[-1:] + durations[-1:])
        for index, way in self.ways.items():
            places = _on(way, instants)
            held = np.where(durations > 0.0, durations, math.inf)[:, None]
            velocities = np.diff(places, axis=0) / held
            states[:, index, _PLACE] = places[:-1] - times[:, None] * velocities
            states[:, index, _VELOCITY] = velocities
            states[:, index, _RADIUS] += _astray(way, instants, places)
        return states

    def _between(self, times: Array) -> tuple[Array, Array]:
        """Greatest radius and speed of each disc between two times, both ``(N, M)``."""
        durations = np.diff(times)
        legs = self.legs(durations)
        radii = legs[..., _RADIUS] + legs[..., _GROWTH] * durations[:, None]
        return radii, np.hypot(legs[..., 2], legs[..., 3])


NOTHING_MOVES = MovingDiscs((), np.empty((0, _COLUMNS)), np.empty(0, np.int64))  # no discs

_NO_LEGS = np.empty((0, 0, _COLUMNS))


def _on(way: Array, times: Array) -> Array:
    """Places on a way, shape ``(K, 2)`` [m]."""
    return np.column_stack([np.interp(times, way[:, 0], way[:, i]) for i in (1, 2)])


def _astray(way: Array, times: Array, places: Array) -> Array:
    """Distance by which a way strays from straight lines between some of its places."""
    step = np.searchsorted(times, way[:, 0], side='right') - 1
    inside = (step >= 0) & (step < len(times) - 1)
    knots, found = way[inside], np.zeros(len(times) - 1)
    away = knots[:, 1:] - _on(np.column_stack([times, places]), knots[:, 0])
    # Between two bends the distance of two points that keep their velocities is greatest at an end.
    np.maximum.at(found, step[inside], np.hypot(away[:, 0], away[:, 1]))
    return found


@allocation_free
def _put_legs(legs: Array, states: Array, durations: Array) -> None:
    begin = 0.0
    for k in range(durations.shape[0]):
        end = begin + durations[k]
        for j in range(states.shape[0]):
            x, y, u, v, radius, _ = disc_after(states, j, begin, 0.0)
            leg = legs[k, j]
            leg[0], leg[1], leg[2], leg[3], leg[4] = x, y, u, v, radius
            leg[_GROWTH] = states[j, _GROWTH] + 0.5 * (begin + end) * states[j, _BEND]
            leg[_BEND] = 0.0
        begin = end


@allocation_free
def put_clearance(
    clearance: Array,
    points: Array,
    states: Array,
    poses: Array,
    twists: Array,
    durations: Array,
    times: Array,
) -> None:
    """Fill in the clearance of `MovingDiscs.along`; of poses, twists and states one may do."""
    for k in range(durations.shape[0]):
        at = min(k, twists.shape[0] - 1)
        whole = arc_under(poses, twists, at, durations[k])
        of_arc = states[min(k, states.shape[0] - 1)]
        for i in range(points.shape[0]):
            arc = arc_of_point(whole, poses[at, 2], points, i)
            for j in range(states.shape[1]):
                x, y, u, v, radius, growth = disc_after(of_arc, j, times[k], durations[k])
                bound = np.inf if i == 0 else clearance[k, j] + radius
                least = sweep_moving(arc, durations[k], x, y, u, v, growth, bound) - radius
                if i == 0 or least < clearance[k, j] or np.isnan(least):
                    clearance[k, j] = least


@allocation_free
def disc_after(states: Array, j: int, time: float, lasting: float) -> Any:
    """Centre, velocity, radius and mean growth (x, y, u, v, radius, growth) some time later."""
    u, v, growth, bend = states[j, 2], states[j, 3], states[j, 5], states[j, 6]
    radius = states[j, 4] + (growth + 0.5 * bend * time) * time
    x, y = states[j, 0] + time * u, states[j, 1] + time * v
    return x, y, u, v, radius, growth + bend * (time + 0.5 * lasting)


@allocation_free
def sweep_moving(
    arc: Arc,
    duration: float,
    x: float,
    y: float,
    velocity_x: float,
    velocity_y: float,
    growth: float,
    enough: float,
) -> float:
    """Least distance, in time, of an arc from a point that moves, less a radius that grows from 0.

    Seen from the point, the path strays from a chord as far as the arc does from its own: the
    point's speed is constant. A distance above `enough` need not be known more exactly.
    """
    astray = abs(arc.length * arc.turn) / 8.0
    away_x, away_y = arc.x - x, arc.y - y
    moved_x, moved_y, grown = velocity_x * duration, velocity_y * duration, growth * duration
    whole = (
        _least_on_approach(
            away_x, away_y, arc.end_x - x - moved_x, arc.end_y - y - moved_y, 0.0, grown
        )
        - astray
    )
    if whole > enough or math.isnan(whole):
        return whole
    pieces = pieces_for(astray)
    least, from_x, from_y = math.inf, away_x, away_y
    for i in range(1, pieces + 1):
        part = i / pieces
        to_x, to_y, _, _ = arc_part(arc, part)
        to_x, to_y = to_x - x - part * moved_x, to_y - y - part * moved_y
        before = (i - 1) / pieces * grown
        least = min(least, _least_on_approach(from_x, from_y, to_x, to_y, before, part * grown))
        from_x, from_y = to_x, to_y
    return least - astray / (pieces * pieces)


@allocation_free
def _least_on_approach(
    x: float, y: float, to_x: float, to_y: float, radius: float, to_radius: float
) -> float:
    """Least distance from the origin on a straight way, less an evenly changing radius: convex."""
    way_x, way_y, grown = to_x - x, to_y - y, to_radius - radius
    squared = way_x * way_x + way_y * way_y
    at_end = math.sqrt(to_x * to_x + to_y * to_y) - to_radius
    least = min(math.sqrt(x * x + y * y) - radius, at_end)
    steeper = squared - grown * grown
    if steeper <= 0.0:
        return least
    across = abs(way_x * y - way_y * x) / math.sqrt(squared)
    part = (grown * across / math.sqrt(steeper) * math.sqrt(squared)) / squared
    part -= (x * way_x + y * way_y) / squared
    if not 0.0 < part < 1.0:
        return least
    there_x, there_y = x + part * way_x, y + part * way_y
    there = math.sqrt(there_x * there_x + there_y * there_y) - radius - part * grown
    return min(least, there)
