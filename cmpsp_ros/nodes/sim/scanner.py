"""The simulator's laser scanner: what surrounds it, and its scans as messages."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Quaternion, TransformStamped
from rclpy.time import Time
from sensor_msgs.msg import LaserScan

from cmpsp_ros.nodes.common.topics import SIM_SCAN
from cmpsp_ros.parameters import laser_settings, scenery
from cmpsp_ros.simulator import Laser, discs_of, edges_of

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time as TimeMessage

    from cmpsp_ros.nodes.sim.moving_obstacles import Traffic
    from cmpsp_ros.nodes.sim.node import SimNode
    from cmpsp_ros.parameters import Values
    from cmpsp_ros.simulator import Motion


class Scanner:
    """A laser among the shapes of a course, those that only the simulator knows, and traffic."""

    def __init__(self, sim: SimNode, traffic: Traffic) -> None:
        """Begin to scan.

        Args:
            sim: The simulator.
            traffic: What moves.

        Raises:
            ParameterError: The parameters of the scanner do not fit together.
        """
        values, motion = sim.values, sim.plant.motion
        self._settings, self._traffic = laser_settings(values), traffic
        self._laser = Laser(self._settings, motion.stamp_ns)
        self._frame_id = values['sim.scan.frame_id']
        self._publisher = SIM_SCAN.publish_on(sim)
        self._complete: list[LaserScan] = []
        self._published_ns = motion.stamp_ns
        self.look_around(values)
        self.note(motion)

    def look_around(self, values: Values) -> None:
        """Take in the shapes of a course."""
        shapes, lines = scenery(values)
        self._edges, self._discs = edges_of(shapes, lines), discs_of(shapes)

    def reset(self, motion: Motion) -> None:
        """Begin anew."""
        self._complete.clear()
        self._laser.reset(motion.stamp_ns)
        self.note(motion)

    def note(self, *motions: Motion) -> None:
        """Remember how the robot moves from some instants on, in order."""
        self._laser.note(*motions)

    def publish(self, stamp_ns: int) -> None:
        """Publish the scans completed by an instant [ns], at the same instant again the same."""
        if stamp_ns != self._published_ns:
            self._complete.clear()
        self._published_ns = stamp_ns
        while self._laser.is_due(stamp_ns):
            self._complete.append(self._next())
        for each in self._complete:
            self._publisher.publish(each)

    def transform(self, stamp: TimeMessage, base: str) -> TransformStamped:
        """Where the scanner is on the robot."""
        x, y, heading = self._settings.pose
        message = TransformStamped(child_frame_id=self._frame_id)
        message.header.stamp, message.header.frame_id = stamp, base
        message.transform.translation.x, message.transform.translation.y = x, y
        message.transform.rotation = Quaternion(
            x=0.0, y=0.0, z=math.sin(heading / 2.0), w=math.cos(heading / 2.0)
        )
        return message

    def _next(self) -> LaserScan:
        settings = self._settings
        moving = [
            (each.x, each.y, each.vx, each.vy, each.radius)
            for each in self._traffic.at(self._laser.next_ns)
        ]
        discs = np.vstack([self._discs, np.array(moving).reshape(-1, 5)])
        scan = self._laser.scan(self._edges, discs)
        message = LaserScan(
            angle_min=settings.angle_min,
            angle_max=settings.angle_max,
            angle_increment=settings.angle_increment,
            time_increment=settings.time_increment,
            scan_time=1.0 / settings.rate,
            range_min=settings.range_min,
            range_max=settings.range_max,
            ranges=scan.ranges.astype(np.float32),
        )
        message.header.stamp = Time(nanoseconds=scan.stamp_ns).to_msg()
        message.header.frame_id = self._frame_id
        return message
