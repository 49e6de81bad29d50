"""Surroundings of the robot: fusion of all sensors, by odometry of their times."""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.robots import Footprint, placed
from cmpsp_ros.sensing.beams import Beams, Sight, SightSettings
from cmpsp_ros.sensing.local_grid import LocalGrid
from cmpsp_ros.sensing.projection import projected
from cmpsp_ros.sensing.track import Track
from cmpsp_ros.sensing.tracker import Tracker
from cmpsp_ros.world.grids import OccupancyGrid

_NS = 1_000_000_000
_SPAN = 10 * _NS
_MAX_PENDING = 100


@dataclass(frozen=True, eq=False)
class Sighting:
    """Surroundings at the stamp of the odometry at which they were new [ns]."""

    stamp: int  # that time
    grid: OccupancyGrid  # grid of all that stands still
    tracks: tuple[Track, ...] = ()  # all that moves, predicted for that time


class Surroundings:
    """Fuses sightings of sensors, each by the odometry of its own time, in any order of arrival."""

    def __init__(
        self, settings: SightSettings, robot_radius: float, footprint: Footprint | None = None
    ) -> None:
        """Start with nothing seen; the radius [m] is that of the discs that cover the robot."""
        self._settings = settings
        self._robot_radius, self._footprint = robot_radius, footprint or Footprint()
        self.forget()

    def forget(self) -> None:
        """Forget everything."""
        settings = self._settings
        self._grid = LocalGrid(settings.size, settings.resolution, settings.memory)
        self._tracker = Tracker() if settings.moving else None
        self._poses = PoseHistory(_SPAN)
        self._pending: list[Sight] = []
        self._seen: dict[str, int] = {}
        self._sighting: Sighting | None = None
        self._is_stale = False

    def add(self, sight: Sight) -> None:
        """Keep a sight for the odometry after it; of too many the oldest are dropped."""
        self._pending.append(sight)
        del self._pending[:-_MAX_PENDING]

    def update(self, stamp: int, pose: Array) -> None:
        """Follow the robot to a pose ``(3,)`` [m, m, rad], and use all sights until then [ns]."""
        self._poses.add(stamp, pose)
        come = [each for each in self._pending if each.stamp <= stamp]
        self._pending = [each for each in self._pending if each.stamp > stamp]
        self._grid.center_on(float(pose[0]), float(pose[1]))
        for each in sorted(come, key=lambda each: (each.stamp, each.sensor.name)):
            if self._is_usable(each):
                self._see(each.sensor.name, projected(each, self._poses.at(each.stamps)), pose)
                self._seen[each.sensor.name] = each.stamp
                self._is_stale = True

    def at(self, stamp: int, pose: Array) -> Sighting | None:
        """Sighting at the last update; the same as before where no sensor has shown more."""
        if self._is_stale:
            corners = self._footprint.at(pose) if self._footprint.corners else None
            for x, y in placed(self._footprint.discs, pose).tolist():
                self._grid.stand_at(x, y, self._robot_radius, stamp, corners)
            tracks = self._tracker.tracks(stamp) if self._tracker is not None else ()
            grid = self._grid.at(stamp, round(self._settings.timeout * _NS))
            self._sighting = Sighting(stamp, grid, tracks)
            self._is_stale = False
        return self._sighting

    def blindness(self, stamp: int) -> str:
        """Sentence on a sensor that has shown nothing for too long at a time [ns], or empty."""
        timeout = self._settings.timeout
        for each in self._settings.sensors:
            seen = self._seen.get(each.name)
            if seen is None:
                wanted = f'sensor {each.name} on {each.topic}'
                return f'Waiting for the first usable message of {wanted}.'
            if stamp - seen > timeout * _NS:
                age = (stamp - seen) / _NS
                return f'Sensor {each.name} has shown nothing for {age:.3f} s (sight.timeout).'
        return ''

    def _see(self, sensor: str, beams: Beams, pose: Array) -> None:
        """Enter static obstacles into the grid, and track moving ones."""
        if self._tracker is None:
            self._grid.see(beams)
            return
        discs = placed(self._footprint.discs, pose)
        robot = np.column_stack([discs, np.full(len(discs), self._robot_radius)])
        owners, begun = self._tracker.update(sensor, beams, robot)
        for each in begun:
            self._grid.release(each)
        self._grid.see(beams, owners)

    def _is_usable(self, sight: Sight) -> bool:
        """True if poses reach back to its first beam, and no newer one of that sensor was used."""
        first = int(sight.stamps[0]) if len(sight.stamps) else sight.stamp
        newest = self._seen.get(sight.sensor.name)
        return not self._poses.is_after(first) and (newest is None or sight.stamp > newest)


class PoseHistory:
    """Odometry of the last seconds, interpolated."""

    def __init__(self, span: int) -> None:
        """Start without poses; each is remembered for a time [ns]."""
        self._span = span
        self._stamps: list[int] = []
        self._poses: list[list[float]] = []

    def add(self, stamp: int, pose: Array) -> None:
        """Remember a pose ``(3,)`` [m, m, rad], unless its stamp [ns] is not the latest."""
        if self._stamps and stamp <= self._stamps[-1]:
            return
        x, y, heading = pose.tolist()
        if self._poses:
            before = self._poses[-1][2]
            heading = before + math.remainder(heading - before, math.tau)
        self._stamps.append(stamp)
        self._poses.append([x, y, heading])
        old = max(bisect_right(self._stamps, stamp - self._span) - 1, 0)
        del self._stamps[:old], self._poses[:old]

    def is_after(self, stamp: int) -> bool:
        """True if the first pose is newer than a time [ns]."""
        return bool(self._stamps) and self._stamps[0] > stamp

    def at(self, stamps: IntArray) -> Array:
        """Poses [m, m, rad] at ascending times ``(K,)`` [ns] from the first to the last.

        Shape ``(K, 3)``, or ``(1, 3)`` if all times are the same.
        """
        low = max(bisect_right(self._stamps, stamps.min(initial=self._stamps[-1])) - 1, 0)
        high = bisect_left(self._stamps, stamps.max(initial=self._stamps[0])) + 1
        # An empty cloud has no stamps.
        high, first = max(high, low + 1), self._stamps[low]
        known = np.array(self._stamps[low:high]) - first
        poses = np.array(self._poses[low:high])
        if len(stamps) and stamps[0] == stamps[-1]:
            stamps = stamps[:1]
        return np.column_stack([np.interp(stamps - first, known, each) for each in poses.T])
