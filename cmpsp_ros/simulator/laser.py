"""A laser scanner on the simulated robot: when it scans, from where, and what goes wrong.

The robot moves while a scan is made: each beam starts from the pose of its own time.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.robots import arc_ends
from cmpsp_ros.simulator.body import Motion
from cmpsp_ros.simulator.random_streams import Stream, generator
from cmpsp_ros.simulator.ray_casting import cast
from cmpsp_ros.simulator.settings import LaserSettings

_NS = 1_000_000_000


class Scan(NamedTuple):
    """A scan that is complete.

    Attributes:
        stamp_ns: When its first beam was cast [ns].
        ranges: NaN, ``-inf`` and ``inf`` as in REP 117, shape ``(count,)`` [m].
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
        """Whether a scan has been completed by an instant [ns]."""
        return bool(self._motions) and self.next_ns + self._beams_ns[-1] <= stamp_ns

    def scan(self, edges: Array, discs: Array) -> Scan:
        """The next scan, once it is due.

        Args:
            edges: As of `cast`.
            discs: As of `cast`; where they are at the time of the first beam.
        """
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
