"""Obstacles known to a robot: seen by the simulated scanner, or from a map."""

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import MAP, NANOSECONDS, GuidanceSettings
from cmpsp_ros.sensing import Sighting, Surroundings, sight_of
from cmpsp_ros.simulator import Laser, LaserSettings, Motion, People, Scan, discs_of, edges_of
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import OpenFloor

_CELL: Final = 0.05
_AROUND: Final = 0.5


def map_of(shapes: Sequence[Shape]) -> GridObstacle:
    """A map of shapes: every cell that one of them touches is occupied."""
    space = FreeSpace.of(OpenFloor(), shapes, 0.0)
    reach = (space.reaches + space.radii)[:, None]
    low = (space.centers - reach).min(axis=0) - _AROUND
    columns, rows = np.ceil(((space.centers + reach).max(axis=0) + _AROUND - low) / _CELL)
    cells = np.zeros((int(rows), int(columns)), np.uint8)
    grid = OccupancyGrid((float(low[0]), float(low[1]), 0.0), _CELL, cells)
    centers = grid.centers(*np.indices(cells.shape)).reshape(-1, 2)
    away = space.at(np.column_stack([centers, np.zeros(len(centers))]))[:, 2:].min(axis=1)
    cells[away.reshape(cells.shape) <= _CELL * math.sqrt(0.5)] = Cell.OCCUPIED
    return GridObstacle(MAP, grid)


class Eyes:
    """A scanner among shapes that stand still, and people."""

    def __init__(
        self,
        settings: GuidanceSettings,
        scanner: LaserSettings,
        shapes: Sequence[Shape],
        people: People | None = None,
    ) -> None:
        (self._sensor,), self._scanner = settings.sight.sensors, scanner
        self._laser = Laser(scanner, 0)
        self._surroundings = Surroundings(settings.sight, settings.robot_radius, settings.footprint)
        self._edges, self._discs, self._people = edges_of(shapes), discs_of(shapes), people

    def note(self, *motions: Motion) -> None:
        """Know how the robot moves from some instants on, in order."""
        self._laser.note(*motions)

    def look(self, stamp: int) -> None:
        """Scan as often as is due by an instant [ns]."""
        while self._laser.is_due(stamp):
            discs = self._discs
            if self._people is not None:
                discs = np.vstack([discs, self._people.visible_at(self._laser.next_ns)])
            scan = self._laser.scan(self._edges, discs)
            self._surroundings.add(sight_of(self._message(scan), self._sensor))

    def see(self, stamp: int, pose: Array) -> Sighting | None:
        """Surroundings known by the time [ns] and pose ``(3,)`` [m, m, rad] of odometry."""
        self._surroundings.update(stamp, pose)
        return self._surroundings.at(stamp, pose)

    def _message(self, scan: Scan) -> SimpleNamespace:
        scanner, (seconds, nanoseconds) = self._scanner, divmod(scan.stamp_ns, NANOSECONDS)
        stamp = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
        return SimpleNamespace(
            header=SimpleNamespace(frame_id=self._sensor.frame_id, stamp=stamp),
            ranges=scan.ranges.astype(np.float32),
            angle_min=scanner.angle_min,
            angle_max=scanner.angle_max,
            angle_increment=scanner.angle_increment,
            time_increment=scanner.time_increment,
            range_min=scanner.range_min,
            range_max=scanner.range_max,
        )
