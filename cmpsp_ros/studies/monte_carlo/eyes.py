"""What a robot sees on its way: the simulated scanner, and the grid of what it has shown."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.sensing.laser_scan import sight_of
from cmpsp_ros.sensing.surroundings import Sighting, Surroundings
from cmpsp_ros.simulator.body import Motion
from cmpsp_ros.simulator.laser import Laser, LaserSettings, Scan
from cmpsp_ros.simulator.ray_casting import discs_of, edges_of
from cmpsp_ros.world.obstacles.shapes import Shape

Array = NDArray[np.float64]


class Eyes:
    """A scanner among shapes that stand still."""

    def __init__(
        self, settings: GuidanceSettings, scanner: LaserSettings, shapes: Sequence[Shape]
    ) -> None:
        """See nothing yet.

        Args:
            settings: Of the guidance law, with one sensor.
            scanner: The simulated one.
            shapes: What it sees.
        """
        (self._sensor,), self._scanner = settings.sight.sensors, scanner
        self._laser = Laser(scanner, 0)
        self._surroundings = Surroundings(
            settings.sight, settings.robot_radius, settings.footprint.discs
        )
        self._edges, self._discs = edges_of(shapes), discs_of(shapes)

    def note(self, *motions: Motion) -> None:
        """Know how the robot moves from some instants on, in order."""
        self._laser.note(*motions)

    def see(self, stamp: int, pose: Array) -> Sighting | None:
        """What is known by an instant.

        Args:
            stamp: Of odometry [ns].
            pose: Of odometry, shape ``(3,)`` [m, m, rad].
        """
        while self._laser.is_due(stamp):
            scan = self._laser.scan(self._edges, self._discs)
            self._surroundings.hear(sight_of(self._message(scan), self._sensor))
        self._surroundings.note(stamp, pose)
        return self._surroundings.at(stamp, pose)

    def _message(self, scan: Scan) -> SimpleNamespace:
        """A scan as a `sensor_msgs/LaserScan`, of whose precision its ranges are."""
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
