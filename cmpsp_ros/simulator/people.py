"""People on foot around the simulated robot: their waypoints, and what a scanner sees of them."""

import math
from collections import deque
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.simulator.laser import cast
from cmpsp_ros.simulator.measurement import Stream, generator
from cmpsp_ros.simulator.settings import PeopleSettings, Walker
from cmpsp_ros.simulator.walking import choose_velocities

Point = tuple[float, float]

_NS: Final = 1_000_000_000
_REMEMBERED: Final = 100  # steps that are kept: a scan finds people where they were

# Distance from a waypoint [m], and time [s] below a speed [m/s], after which the next is due.
_ARRIVED, _STUCK, _SLOW = 0.2, 1.0, 0.05

_FROM_WALL, _SHORTEST, _ATTEMPTS = 0.1, 0.5, 16
# Radius of a leg, half the distance of both, length of two steps, amplitude of a foot [m].
_LEG, _HALF_STANCE, _STRIDE, _SWING = 0.06, 0.1, 1.3, 0.16


class People:
    """People during one run; at rest until it begins."""

    def __init__(self, settings: PeopleSettings, edges: Array, discs: Array) -> None:
        """Place them among straight edges and discs; arguments as of `cast`."""
        self._settings = settings
        self._edges, self._posts = edges, discs
        members = [each for each in settings.walkers for _ in range(each.count)]
        self.names = [
            each.name if each.count == 1 else f'{each.name} {number + 1}'
            for each in settings.walkers
            for number in range(each.count)
        ]
        self._group = np.repeat(
            np.arange(len(settings.walkers)), [each.count for each in settings.walkers]
        )
        self._leaders = np.searchsorted(self._group, np.arange(len(settings.walkers)))
        self._radii = np.array([each.radius for each in members])
        self._people = np.array(
            [
                (each.radius, each.speed, each.gives_way, group)
                for each, group in zip(members, self._group, strict=True)
            ],
            dtype=float,
        ).reshape(-1, 4)
        offsets = [each.formation for each in settings.walkers]
        self._offsets = np.vstack([*offsets, np.empty((0, 2))])
        self.reset()

    def __len__(self) -> int:
        return len(self._radii)

    def reset(self) -> None:
        """Return to the initial positions, at rest until `begin`."""
        walkers = self._settings.walkers
        self._random = generator(self._settings.seed, Stream.PEOPLE)
        self._begun = False
        self._places = self._offsets + np.array(
            [walkers[each].position for each in self._group], dtype=float
        ).reshape(-1, 2)
        self._velocities, self._walked = np.zeros_like(self._places), np.zeros(len(self))
        self._headings = np.array([walkers[each].heading for each in self._group], dtype=float)
        self._waited = np.zeros(len(walkers))
        self._routes = [self._route(each) for each in walkers]
        self._next = [1] * len(walkers)
        self._past: deque[tuple[int, Array, Array, Array]] = deque(maxlen=_REMEMBERED)

    def begin(self, stamp_ns: int) -> None:
        """Walk from now on [ns], unless they walk already."""
        if not self._begun:
            self._begun = True
            self._note(stamp_ns)

    def advance(self, stamp_ns: int, robot: Array, radius: float) -> None:
        """Walk up to an instant [ns], past a robot of discs ``(D, 2)`` and of a radius [m]."""
        if not self._begun or not len(self) or stamp_ns <= self._past[-1][0]:
            return
        duration = (stamp_ns - self._past[-1][0]) / _NS
        self._places = self._places + duration * self._velocities
        self._walked += duration * np.hypot(*self._velocities.T)
        self._choose_waypoints(duration)
        self._accelerate(duration, robot, radius)
        self._note(stamp_ns)

    def at(self, stamp_ns: int) -> Array:
        """Centre, velocity and radius of each body at an instant [ns], ``(P, 5)`` [m, m/s, m]."""
        seconds, places, velocities, _ = self._step_at(stamp_ns)
        return np.column_stack([places + seconds * velocities, velocities, self._radii])

    def visible_at(self, stamp_ns: int) -> Array:
        """Discs that a scanner sees at an instant [ns]: bodies or legs, as of `cast`."""
        bodies = self.at(stamp_ns)
        if not self._settings.legs:
            return bodies
        seconds, _, velocities, walked = self._step_at(stamp_ns)
        speeds = np.hypot(*velocities.T)
        phase = math.tau / _STRIDE * (walked + seconds * speeds)
        ahead = np.column_stack([np.cos(self._headings), np.sin(self._headings)])
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        legs = []
        for side in (1.0, -1.0):
            swing = side * _SWING * np.sin(phase)[:, None] * ahead
            rate = side * _SWING * math.tau / _STRIDE * (speeds * np.cos(phase))[:, None] * ahead
            place = bodies[:, :2] + side * _HALF_STANCE * left + swing
            legs.append(np.column_stack([place, velocities + rate, np.full(len(self), _LEG)]))
        return np.vstack(legs)

    def _note(self, stamp_ns: int) -> None:
        self._past.append((stamp_ns, self._places, self._velocities, self._walked.copy()))

    def _step_at(self, stamp_ns: int) -> tuple[float, Array, Array, Array]:
        """Time since the step under way then [s]; places, velocities and distances at its start."""
        for began, places, velocities, walked in reversed(self._past):
            if began <= stamp_ns:
                return (stamp_ns - began) / _NS, places, velocities, walked
        return 0.0, self._places, np.zeros_like(self._velocities), self._walked

    def _choose_waypoints(self, duration: float) -> None:
        """Send each group whose leader has arrived or is stuck to its next waypoint."""
        for group, leader in enumerate(self._leaders.tolist()):
            route, place = self._routes[group], self._places[leader]
            walker = self._settings.walkers[group]
            slow = np.hypot(*self._velocities[leader]) < _SLOW
            self._waited[group] = self._waited[group] + duration if slow else 0.0
            target = route[self._next[group] % len(route)]
            arrived = math.hypot(*(target - place)) < _ARRIVED
            if not walker.speed or not (arrived or self._waited[group] > _STUCK):
                continue
            self._waited[group] = 0.0
            if walker.motion == 'random':
                route[:] = [self._stroll(place, walker.radius)]
            self._next[group] = (self._next[group] + 1) % len(route)

    def _accelerate(self, duration: float, robot: Array, radius: float) -> None:
        """Choose the velocities until the next step."""
        targets = np.array(
            [route[each % len(route)] for route, each in zip(self._routes, self._next, strict=True)]
        )
        chosen = np.empty_like(self._velocities)
        choose_velocities(
            chosen, self._places, self._velocities, targets[self._group] + self._offsets,
            self._people, self._edges, self._posts, np.ascontiguousarray(robot, dtype=float),
            radius, self._settings.acceleration, duration,
        )  # fmt: skip
        moves = np.hypot(*chosen.T) > _SLOW
        self._headings[moves] = np.arctan2(chosen[moves, 1], chosen[moves, 0])
        self._velocities = chosen

    def _route(self, walker: Walker) -> list[Array]:
        """Waypoints of a walker, to be visited in a circle."""
        begin = np.array(walker.position, dtype=float)
        if walker.motion == 'waypoints':
            points = [begin, *np.array(walker.waypoints, dtype=float).reshape(-1, 2)]
            return points + points[-2:0:-1]
        if walker.motion == 'random':
            return [begin, self._stroll(begin, walker.radius)]
        ahead = np.array([math.cos(walker.heading), math.sin(walker.heading)])
        headings = walker.heading, walker.heading + math.pi
        free = [self._free_way(begin, each, walker.radius) for each in headings]
        return [begin - free[1] * ahead, begin + free[0] * ahead]

    def _stroll(self, place: Array, radius: float) -> Array:
        """Another point in a straight line without walls in between."""
        for _ in range(_ATTEMPTS):
            heading = self._random.uniform(-math.pi, math.pi)
            free = self._free_way(place, heading, radius)
            if free > _SHORTEST:
                length = self._random.uniform(_SHORTEST, free)
                return place + length * np.array([math.cos(heading), math.sin(heading)])
        return place

    def _free_way(self, place: Array, heading: float, radius: float) -> float:
        """Distance that a body can walk straight ahead [m]; 50 m where nothing is in its way."""
        aside = radius * np.array([-math.sin(heading), math.cos(heading)])
        rays = np.array([[*(place + part * aside), heading] for part in (-1.0, 0.0, 1.0)])
        ranges = np.empty(3)
        cast(ranges, rays, np.zeros(3), self._edges, self._posts)
        return max(min(float(ranges.min()), 50.0) - radius - _FROM_WALL, 0.0)
