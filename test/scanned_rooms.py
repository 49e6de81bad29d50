"""Rooms with walkers, as a scanner on a robot with odometry sees them."""

import math
from dataclasses import dataclass, field

import numpy as np

from cmpsp_ros.sensing import Sensor, Sight, SightSettings, Surroundings
from cmpsp_ros.simulator.laser import cast
from cmpsp_ros.world.grids import Cell

SENSOR = Sensor('front', 'laser')
RADIUS = 0.25
FIRST = 2**24 + 1


def box(left, low, right, high):
    return [
        (left, low, right, low),
        (right, low, right, high),
        (right, high, left, high),
        (left, high, left, low),
    ]


ROOM = box(0.0, 0.0, 12.0, 6.0)
DOOR = [*ROOM, *box(5.9, 0.0, 6.1, 2.5), *box(5.9, 3.6, 6.1, 6.0)]


def occupied(sighting):
    """Centres of occupied cells, ``(K, 2)`` [m]."""
    grid = sighting.grid
    return grid.centers(*np.nonzero(grid.cells == Cell.OCCUPIED))


def straight(x, y, vx, vy, begin=0.0, end=math.inf):
    """Walker with a velocity from one time to another."""

    def at(time):
        walked = min(max(time, begin), end) - begin
        return x + walked * vx, y + walked * vy

    return at


@dataclass
class Faults:
    """Errors of scanner and odometry."""

    missed: float = 0.0
    unknown: float = 0.0
    odometry: tuple[float, float] = (0.0, 0.0)
    legs: bool = False


@dataclass
class ScannedRoom:
    """A room with walls, posts (x, y, radius) and walkers; scans are made ten times a second."""

    edges: list = field(default_factory=lambda: ROOM)
    posts: list = field(default_factory=list)
    walkers: list = field(default_factory=list)
    robot: object = lambda _time: (1.0, 3.0, 0.0)
    faults: Faults = field(default_factory=Faults)
    reach: float = 12.0
    size: float = 14.0
    jumps: tuple[float, tuple[float, float, float]] = (math.inf, (0.0, 0.0, 0.0))

    def __post_init__(self):
        self.random = np.random.default_rng(0)
        self.known = Surroundings(SightSettings((SENSOR,), size=self.size), 0.25)
        self.angles = np.linspace(-0.75 * math.pi, 0.75 * math.pi, 541)
        self.edges = np.array(self.edges, float).reshape(-1, 4)

    def discs(self, time):
        discs = [(x, y, 0.0, 0.0, radius) for x, y, radius in self.posts]
        for each in self.walkers:
            (x, y), (next_x, next_y) = each(time), each(time + 0.01)
            heading = math.atan2(next_y - y, next_x - x)
            speed = math.hypot(next_x - x, next_y - y) / 0.01
            if not self.faults.legs:
                discs.append((x, y, 0.0, 0.0, RADIUS))
                continue
            for side in (1.0, -1.0):
                ahead = 0.25 * side * math.sin(math.tau * time * speed / 1.2)
                leg = complex(ahead, 0.1 * side) * complex(math.cos(heading), math.sin(heading))
                discs.append((x + leg.real, y + leg.imag, 0.0, 0.0, 0.07))
        return np.array(discs, float).reshape(-1, 5)

    def sight(self, time):
        count = len(self.angles)
        x, y, heading = self.robot(time)
        rays = np.column_stack([np.full(count, x), np.full(count, y), heading + self.angles])
        ranges = np.empty(count)
        cast(ranges, rays, np.zeros(count), self.edges, self.discs(time))
        ranges += 0.01 * self.random.standard_normal(count)
        missed, unknown = self.random.random((2, count))
        hits = (ranges < self.reach) & (missed >= self.faults.missed)
        lengths = np.where(hits, ranges, self.reach)
        hits &= unknown >= self.faults.unknown
        lengths[unknown < self.faults.unknown] = 0.0
        ends = lengths[:, None] * np.column_stack([np.cos(self.angles), np.sin(self.angles)])
        stamps = np.full(count, round(time * 1e9))
        return Sight(
            SENSOR, int(stamps[-1]), stamps, np.zeros((count, 2)), ends, hits, is_sweep=True
        )

    def run(self, until, begin=0.0):
        """Time and sighting after each scan."""
        for k in range(round(10 * begin), round(10 * until) + 1):
            time, (moved, turned) = k / 10.0, self.faults.odometry
            noise = self.random.standard_normal(3) * (moved, moved, turned)
            pose, stamp = np.array(self.robot(time)) + noise, round(time * 1e9)
            since, jump = self.jumps
            pose += np.array(jump) * (time >= since)
            self.known.add(self.sight(time))
            self.known.update(stamp, pose)
            yield time, self.known.at(stamp, pose)


class Score:
    """Comparison of tracks with the walkers."""

    def __init__(self, room, until, begin=0.0):
        self.ids = [set() for _ in room.walkers]
        self.first = [math.inf for _ in room.walkers]
        self.errors, self.missed, self.false = [], 0, []
        for time, sighting in room.run(until, begin):
            self.sighting = sighting
            places = [each(time) for each in room.walkers]
            for track in sighting.tracks:
                away = [math.dist((track.x, track.y), each) for each in places]
                nearest = int(np.argmin(away)) if away else -1
                if nearest < 0 or away[nearest] > 0.6:
                    self.false.append((time, track))
                    continue
                self.ids[nearest].add(track.id - FIRST)
                self.first[nearest] = min(self.first[nearest], time)
                self.errors.append(away[nearest])
            for walker, place in enumerate(places):
                at = [(each.x, each.y) for each in sighting.tracks]
                seen = any(math.dist(place, each) < 0.4 for each in at)
                self.missed += self.first[walker] < time and not seen
