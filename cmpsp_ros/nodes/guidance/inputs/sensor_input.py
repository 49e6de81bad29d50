"""What the guidance node hears of its sensors, and what it makes of that."""

from __future__ import annotations

from array import array
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from nav_msgs.msg import OccupancyGrid as GridMessage
from rclpy.time import Time
from sensor_msgs.msg import LaserScan, PointCloud2

from cmpsp_ros.arrays import Array
from cmpsp_ros.nodes.common.topics import SCAN, SIGHTING
from cmpsp_ros.nodes.timing.drain_queue import drain_queue
from cmpsp_ros.sensing import ScanError, Sensor, Surroundings, sight_of
from cmpsp_ros.world.grids import Cell

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.guidance import GuidanceSettings
    from cmpsp_ros.sensing import Sighting

_THROTTLE = 2.0
_MESSAGES = {'scan': LaserScan, 'cloud': PointCloud2}

# Of `Cell`, as a nav_msgs/OccupancyGrid has them.
_VALUES = np.zeros(len(Cell), dtype=np.int8)
_VALUES[[Cell.OCCUPIED, Cell.UNKNOWN]] = 100, -1


class SensorInput:
    """Listens to all sensors, and publishes what a decision knows of the surroundings.

    A message that cannot be used changes nothing: it is warned of, and what is known grows old.
    """

    def __init__(self, node: LifecycleNode, settings: GuidanceSettings) -> None:
        """Open the topics."""
        self._node, self._frame_id = node, settings.frame_id
        footprint = settings.robot_radius, settings.footprint
        self._surroundings = Surroundings(settings.sight, *footprint)
        self._refusals: dict[str, str] = {}
        self._sensors = settings.sight.sensors
        self._subscriptions = [
            replace(SCAN, name=each.topic, type=_MESSAGES[each.type]).listen_on(
                node, partial(self._hear, each)
            )
            for each in self._sensors
        ]
        self._publisher = SIGHTING.publish_on(node) if self._sensors else None

    def note(self, stamp: int, pose: Array) -> str:
        """Know where the robot is; why it must stop, if a sensor has shown nothing for too long.

        Args:
            stamp: Time stamp of odometry [ns].
            pose: Shape ``(3,)`` [m, m, rad].
        """
        if not self._sensors:
            return ''
        for each in self._subscriptions:
            drain_queue(each)
        self._surroundings.update(stamp, pose)
        return self._surroundings.blindness(stamp)

    def at(self, stamp: int, pose: Array) -> Sighting | None:
        """What is known where odometry was noted last; published where it is new."""
        sighting = self._surroundings.at(stamp, pose)
        if self._publisher is not None and sighting is not None and sighting.stamp == stamp:
            self._publisher.publish(self._message(sighting))
        return sighting

    def forget(self) -> None:
        """Know nothing again: time has jumped back."""
        self._surroundings.forget()

    def warnings(self) -> list[str]:
        """Why the last message of a sensor was refused, if it was."""
        return [each for each in self._refusals.values() if each]

    def close(self) -> None:
        """Close the topics."""
        for each in self._subscriptions:
            self._node.destroy_subscription(each)
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)

    def _hear(self, sensor: Sensor, message: Any) -> None:
        try:
            sight = sight_of(message, sensor)
        except ScanError as error:
            self._refusals[sensor.name] = f'A message of a sensor is refused: {error}.'
            self._node.get_logger().warning(
                self._refusals[sensor.name], throttle_duration_sec=_THROTTLE
            )
        else:
            self._refusals[sensor.name] = ''
            self._surroundings.add(sight)

    def _message(self, sighting: Sighting) -> GridMessage:
        grid, message = sighting.grid, GridMessage()
        message.header.stamp = Time(nanoseconds=sighting.stamp).to_msg()
        message.header.frame_id = self._frame_id
        message.info.resolution = grid.resolution
        message.info.height, message.info.width = grid.cells.shape
        x, y, _ = grid.origin
        message.info.origin.position.x, message.info.origin.position.y = x, y
        message.info.origin.orientation.w = 1.0
        message.data = array('b', _VALUES[grid.cells].tobytes())
        return message
