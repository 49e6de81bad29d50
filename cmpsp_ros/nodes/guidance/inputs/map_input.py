"""Maps and costmaps that are received, which become the map."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from nav_msgs.msg import OccupancyGrid as GridMessage
from rclpy.qos import QoSProfile

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import TransformError, compose
from cmpsp_ros.nodes.common.parameters import change_parameters
from cmpsp_ros.nodes.common.topics import GUIDANCE_MAP
from cmpsp_ros.parameters import text_of
from cmpsp_ros.sensing import grid_of, stamp_of, updated

try:
    from map_msgs.msg import OccupancyGridUpdate
except ImportError:
    OccupancyGridUpdate = None

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.nodes.guidance.inputs.transform_input import TransformInput
    from cmpsp_ros.parameters import Values
    from cmpsp_ros.world.grids import OccupancyGrid


class MapInput:
    """Listens, where `map.topic` names a topic, and makes each map a change of parameters.

    So it is checked with the whole set, takes effect between two control steps and is recorded, as
    any live change. One that is refused stops the robot: the one before is out of date.

    Attributes:
        waits: Whether the first map is still to come.
        refusal: Why the last map was refused, if it was.
    """

    def __init__(self, node: LifecycleNode, values: Values, transforms: TransformInput) -> None:
        """Open the topics, where there is to be one.

        Args:
            node: Holds the parameters.
            values: Of the node, as it was configured with them.
            transforms: Lead to the frame of the course.
        """
        self._node, self._transforms = node, transforms
        self._topic, self._lethal = values['map.topic'], values['map.lethal']
        self._timeout = values['map.timeout']
        self.waits, self.refusal = bool(self._topic), ''
        # As it came, in its own frame.
        self._grid: OccupancyGrid | None = None
        self._frame, self._stamp, self._lacks_transform = '', 0, False
        self._subscriptions = []
        if self.waits:
            topic = replace(GUIDANCE_MAP, name=self._topic)
            self._subscriptions.append(topic.listen_on(node, self._hear))
            if OccupancyGridUpdate is not None:
                name = f'{self._topic}_updates'
                self._subscriptions.append(
                    node.create_subscription(
                        OccupancyGridUpdate, name, self._hear_update, QoSProfile(depth=10)
                    )
                )
            node.get_logger().info(self.waiting)

    @property
    def waiting(self) -> str:
        """What is still to come, in a sentence; empty when it is there."""
        return f'Waiting for a map on the topic {self._topic}.' if self.waits else ''

    def close(self) -> None:
        """Close the topics."""
        for each in self._subscriptions:
            self._node.destroy_subscription(each)

    def try_again(self) -> None:
        """Take a map for which there was no transform, if there is one by now."""
        if self._lacks_transform:
            self._take()

    def trouble(self, stamp: int) -> str:
        """Why the robot must stop: the last map was refused, or is too old; else empty.

        Args:
            stamp: Time stamp of odometry [ns].
        """
        age = (stamp - self._stamp) / NANOSECONDS
        if not self.refusal and self._topic and 0.0 < self._timeout < age:
            return f'The map is {age:.3f} s old (map.timeout).'
        return self.refusal

    def _hear(self, message: GridMessage) -> None:
        frame = message.header.frame_id
        try:
            self._grid = grid_of(message, frame, self._lethal)
        except ValueError as error:
            self._refuse(error)
            return
        self._frame, self._stamp = frame, stamp_of(message)
        self._take()

    def _hear_update(self, message: OccupancyGridUpdate) -> None:
        if self._grid is None or message.header.frame_id != self._frame:
            return
        try:
            self._grid = updated(self._grid, message, self._lethal)
        except ValueError as error:
            self._refuse(error)
            return
        self._stamp = stamp_of(message)
        self._take()

    def _take(self) -> None:
        """Make the map parameters, in the frame of the course as it is by the latest transform."""
        grid, before = self._grid, self._lacks_transform
        assert grid is not None  # noqa: S101 (one has come)
        self._lacks_transform = False
        try:
            there = self._transforms.frame_pose(self._frame)
            origin = compose(there, np.array(grid.origin)).tolist()
            change_parameters(
                self._node,
                {
                    'map.origin': origin,
                    'map.resolution': grid.resolution,
                    'map.cells': text_of(grid.cells),
                },
            )
        except TransformError as error:
            self._lacks_transform = True
            if not before:
                self._refuse(error)
        except ValueError as error:
            self._refuse(error)
        else:
            self.waits, self.refusal = False, ''

    def _refuse(self, error: ValueError) -> None:
        self.refusal = f'The map that came is refused: {" ".join(str(error).splitlines())}.'
        self._node.get_logger().error(self.refusal)
