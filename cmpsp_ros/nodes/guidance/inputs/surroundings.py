"""Sensors, as the guidance node receives them.

An unusable message changes nothing: a warning is given, and the known state grows old.
"""

from __future__ import annotations

from array import array
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid as GridMessage
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import LaserScan, PointCloud2

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.nodes.common.messages import set_stamp
from cmpsp_ros.nodes.common.topic import Listener
from cmpsp_ros.nodes.common.topics import SCAN, SIGHTING
from cmpsp_ros.sensing import REMEMBERED, ScanError, Sensor, Sighting, Surroundings, sight_of
from cmpsp_ros.world.grids import Cell

_THROTTLE = 2.0
_MESSAGES = {'scan': LaserScan, 'cloud': PointCloud2}

# Values of a nav_msgs/OccupancyGrid by `Cell`.
_VALUES = np.zeros(len(Cell), dtype=np.int8)
_VALUES[[Cell.OCCUPIED, Cell.UNKNOWN, Cell.REMEMBERED]] = 100, -1, REMEMBERED


class SurroundingsInput(Listener):
    """Topics whose last message may have been refused."""

    def __init__(self, node: LifecycleNode) -> None:
        super().__init__(node)
        self._refusals: dict[str, str] = {}

    def _refuse(self, source: str, reason: str, said: str) -> None:
        self._refusals[source] = reason
        self._node.get_logger().warning(said, throttle_duration_sec=_THROTTLE)

    @property
    def refusals(self) -> list[str]:
        """Reasons why last messages were refused."""
        return [each for each in self._refusals.values() if each]


class SensorInput(SurroundingsInput):
    """Listens to all sensors, and publishes the grid that a decision uses."""

    def __init__(self, node: LifecycleNode, settings: GuidanceSettings) -> None:
        super().__init__(node)
        self._frame_id = settings.frame_id
        footprint = settings.robot_radius, settings.footprint
        self._surroundings = Surroundings(settings.sight, *footprint)
        self._sensors = settings.sight.sensors
        for each in self._sensors:
            topic = replace(SCAN, name=each.topic, type=_MESSAGES[each.type])
            self._subscriptions.append(topic.listen_on(node, partial(self._hear, each)))
        self._publisher = SIGHTING.publish_on(node) if self._sensors else None

    def note(self, stamp: int, pose: Array) -> str:
        """Note a pose ``(3,)`` [m, m, rad] of odometry; reason to stop if a sensor is blind."""
        if not self._sensors:
            return ''
        self.drain()
        self._surroundings.update(stamp, pose)
        blind = self._surroundings.blindness(stamp)
        return ' '.join([blind, *self.refusals]) if blind else ''

    def at(self, stamp: int, pose: Array) -> Sighting | None:
        """The grid at the latest odometry; published if new."""
        sighting = self._surroundings.at(stamp, pose)
        if self._publisher is not None and sighting is not None and sighting.stamp == stamp:
            self._publisher.publish(self._message(sighting))
        return sighting

    def forget(self) -> None:
        """Forget everything: time has jumped back."""
        self._surroundings.forget()

    def warnings(self) -> list[str]:
        """Refusals of last messages."""
        return self.refusals

    def close(self) -> None:
        """Close the topics."""
        super().close()
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)

    def _hear(self, sensor: Sensor, message: Any) -> None:
        try:
            sight = sight_of(message, sensor)
        except ScanError as error:
            said = f'A message of a sensor is refused: {error}.'
            self._refuse(sensor.name, said, said)
        else:
            self._refusals[sensor.name] = ''
            self._surroundings.add(sight)

    def _message(self, sighting: Sighting) -> GridMessage:
        grid, message = sighting.grid, GridMessage()
        set_stamp(message.header, sighting.stamp)
        message.header.frame_id = self._frame_id
        message.info.resolution = grid.resolution
        message.info.height, message.info.width = grid.cells.shape
        x, y, _ = grid.origin
        message.info.origin.position.x, message.info.origin.position.y = x, y
        message.info.origin.orientation.w = 1.0
        message.data = array('b', _VALUES[grid.cells].tobytes())
        return message
