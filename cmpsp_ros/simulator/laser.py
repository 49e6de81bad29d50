"""A laser scanner on the simulated robot: times and poses of scans, and their faults.

The robot moves while a scan is made: each beam starts from the pose of its own time.
"""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.simulator.body import Motion
from cmpsp_ros.simulator.measurement import Stream, generator
from cmpsp_ros.simulator.settings import LaserSettings
from cmpsp_ros.world.grids import GridObstacle
from cmpsp_ros.world.obstacles import Shape

_NS = 1_000_000_000


class Scan(NamedTuple):
    """A scan that is complete: when its first beam was cast [ns], and ranges ``(count,)`` [m].

    NaN, ``-inf`` and ``inf`` are as in REP 117.
    """

    stamp_ns: int
    ranges: Array


class Laser:
    """The scanner during one run; it scans from its first motion on."""

    def __init__(self, settings: LaserSettings, start_ns: int) -> None:
        """Begin at a time [ns]."""
        self._settings = settings
        self._period_ns = round(_NS / settings.rate)
        beams_ns = round(_NS * settings.time_increment) * np.arange(settings.count)
        self._beams_ns: IntArray = beams_ns.astype(np.int64)
        self.reset(start_ns)

    def reset(self, stamp_ns: int) -> None:
        """Begin again: a scan that is under way is lost."""
        self.next_ns = stamp_ns
        self._motions: deque[Motion] = deque()
        self._noise = generator(self._settings.seed, Stream.RANGE)
        self._losses = generator(self._settings.seed, Stream.BEAM)

    def note(self, *motions: Motion) -> None:
        """Remember how the robot moves from some instants on, in order."""
        self._motions.extend(motions)
        while len(self._motions) > 1 and self._motions[1].stamp_ns <= self.next_ns:
            self._motions.popleft()

    def is_due(self, stamp_ns: int) -> bool:
        """True once a scan has been completed by an instant [ns]."""
        return bool(self._motions) and self.next_ns + self._beams_ns[-1] <= stamp_ns

    def scan(self, edges: Array, discs: Array) -> Scan:
        """The next scan, once it is due; arguments as of `cast`, as when its first beam is cast."""
        settings, stamp_ns = self._settings, self.next_ns
        rays = self._rays(stamp_ns + self._beams_ns)
        ranges = np.empty(settings.count)
        cast(ranges, rays, self._beams_ns / _NS, edges, discs)
        # Drawn for each beam, needed or not: one disturbance changes no other's numbers.
        ranges += settings.stddev * self._noise.standard_normal(settings.count)
        missed, dropped = self._losses.random((2, settings.count))
        ranges[missed < settings.missed_return] = np.inf
        ranges[ranges < settings.range_min] = -np.inf
        ranges[ranges > settings.range_max] = np.inf
        ranges[dropped < settings.dropout] = np.nan
        self.next_ns += self._period_ns
        return Scan(stamp_ns, ranges)

    def _rays(self, stamps: IntArray) -> Array:
        """Origin and heading of each beam, shape ``(count, 3)`` [m, m, rad]."""
        since = np.array([each.stamp_ns for each in self._motions])
        index = np.maximum(np.searchsorted(since, stamps, side='right') - 1, 0)
        poses = np.array([each.pose for each in self._motions])[index]
        twists = np.array([each.twist for each in self._motions])[index]
        x, y, heading = arc_ends(poses, twists, (stamps - since[index]) / _NS).T
        ahead, left, turned = self._settings.pose
        cosine, sine = np.cos(heading), np.sin(heading)
        return np.column_stack(
            [
                x + cosine * ahead - sine * left,
                y + sine * ahead + cosine * left,
                heading + turned + self._settings.angles,
            ]
        )


# Two edges that share a corner must leave no gap there for a ray.
_OVERLAP = 1e-9


def edges_of(shapes: Sequence[Shape], lines: Iterable[Array] = ()) -> Array:
    """Ends (x, y, x, y) of straight edges, ``(S, 4)`` [m]: of shapes, and of lines ``(K, 2)``."""
    edges = []
    for shape in shapes:
        ring = [*shape.corners, shape.corners[0]] if len(shape.corners) > 1 else []
        for (ax, ay), (bx, by) in pairwise(ring):
            length = math.hypot(bx - ax, by - ay)
            if length == 0.0:
                continue
            outward = shape.radius / length
            dx, dy = outward * (by - ay), outward * (ax - bx)
            edges.append((ax + dx, ay + dy, bx + dx, by + dy))
    maps = [each for each in shapes if isinstance(each, GridObstacle)]
    for line in [*lines, *(line for each in maps for line in each.walls())]:
        edges += [(*before, *after) for before, after in pairwise(line.tolist())]
    return np.array(edges, dtype=float).reshape(-1, 4)


def discs_of(shapes: Iterable[Shape]) -> Array:
    """Discs around the corners of shapes (x, y, vx, vy, radius), shape ``(D, 5)`` [m, m/s, m]."""
    discs = [
        (*corner, 0.0, 0.0, each.radius)
        for each in shapes
        if each.radius
        for corner in each.corners
    ]
    return np.array(discs, dtype=float).reshape(-1, 5)


@allocation_free
def cast(ranges: Array, rays: Array, times: Array, edges: Array, discs: Array) -> None:
    """Fill in the distance along each ray to the first edge or disc [m]; infinite for none.

    `rays` (x, y, heading) ``(R, 3)`` are cast at `times` ``(R,)`` [s]; `edges` (x, y, x, y) ``(S,
    4)`` have two ends, `discs` ``(D, 5)`` a centre at time 0, velocity and radius; within one it is
    0.
    """
    for i in range(rays.shape[0]):
        x, y, cosine, sine = rays[i, 0], rays[i, 1], math.cos(rays[i, 2]), math.sin(rays[i, 2])
        least = math.inf
        for j in range(edges.shape[0]):
            from_x, from_y = edges[j, 0] - x, edges[j, 1] - y
            along_x, along_y = edges[j, 2] - edges[j, 0], edges[j, 3] - edges[j, 1]
            across = cosine * along_y - sine * along_x
            if across == 0.0:
                continue
            distance = (from_x * along_y - from_y * along_x) / across
            part = (from_x * sine - from_y * cosine) / across
            if 0.0 <= distance < least and -_OVERLAP <= part <= 1.0 + _OVERLAP:
                least = distance
        for j in range(discs.shape[0]):
            to_x = discs[j, 0] + times[i] * discs[j, 2] - x
            to_y = discs[j, 1] + times[i] * discs[j, 3] - y
            ahead, beside = cosine * to_x + sine * to_y, cosine * to_y - sine * to_x
            squared = discs[j, 4] * discs[j, 4]
            if to_x * to_x + to_y * to_y <= squared:
                least = 0.0
            elif ahead > 0.0 and beside * beside <= squared:
                least = min(least, ahead - math.sqrt(squared - beside * beside))
        ranges[i] = least
