"""Roads and maps that are received; each becomes a live change of parameters.

So it is checked with the whole set, takes effect between two control steps and is recorded.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Path
from rclpy.lifecycle import LifecycleNode
from rclpy.qos import QoSProfile

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import TransformError, compose
from cmpsp_ros.nodes.common.parameters import change_parameters
from cmpsp_ros.nodes.common.topic import Listener
from cmpsp_ros.nodes.common.topics import GUIDANCE_MAP, GUIDANCE_ROAD
from cmpsp_ros.nodes.guidance.inputs.transforms import TransformInput
from cmpsp_ros.parameters import Values, text_of
from cmpsp_ros.sensing import grid_of, stamp_of, updated
from cmpsp_ros.world.grids import OccupancyGrid

try:
    from map_msgs.msg import OccupancyGridUpdate
except ImportError:
    OccupancyGridUpdate = None


class CourseInput(Listener):
    """Receives a part of the course; it `waits` for the first, and has the last `refusal`."""

    def __init__(self, node: LifecycleNode, transforms: TransformInput) -> None:
        super().__init__(node)
        self._transforms = transforms
        self.waits, self.refusal = False, ''

    def _change(self, changes: dict[str, Any]) -> None:
        """Change parameters; raises ValueError if they are refused."""
        change_parameters(self._node, changes)
        self.waits, self.refusal = False, ''

    def _refuse(self, what: str, error: ValueError) -> None:
        self.refusal = f'The {what} that came is refused: {" ".join(str(error).splitlines())}.'
        self._node.get_logger().error(self.refusal)


class RoadInput(CourseInput):
    """Receives a road if `road.source` is `topic`; a refused road changes nothing."""

    def __init__(self, node: LifecycleNode, values: Values, transforms: TransformInput) -> None:
        super().__init__(node, transforms)
        self.waits = values['road.source'] == 'topic'
        if self.waits:
            self._subscriptions.append(GUIDANCE_ROAD.listen_on(node, self._hear))

    def drive_along(self, path: Path) -> tuple[float, float]:
        """Take the path of an action for the road; its end is the goal. ValueError if refused."""
        if not self._subscriptions:
            raise ValueError('A path needs road.type corridor and road.source topic')
        changes = self._transforms.road_in(path)
        if changes['road.closed']:
            raise ValueError('The path ends where it begins')
        x, y = end = changes['road.points'][-2:]
        self._take({**changes, 'goal.position': end, 'goal.heading': []})
        return x, y

    def _hear(self, message: Path) -> None:
        try:
            self._take(self._transforms.road_in(message))
        except ValueError as error:
            self._refuse('road', error)

    def _take(self, changes: dict[str, Any]) -> None:
        self._change(changes)
        count = len(changes['road.points']) // 2
        self._node.get_logger().info(f'a road of {count} points has come')


class MapInput(CourseInput):
    """Receives `map.topic`, if given; a map that is refused stops the robot."""

    def __init__(self, node: LifecycleNode, values: Values, transforms: TransformInput) -> None:
        super().__init__(node, transforms)
        self._topic, self._lethal = values['map.topic'], values['map.lethal']
        self._timeout = values['map.timeout']
        self.waits = bool(self._topic)
        # As it came, in its own frame.
        self._grid: OccupancyGrid | None = None
        self._frame, self._stamp, self._lacks_transform = '', 0, False
        if not self.waits:
            return
        topic = replace(GUIDANCE_MAP, name=self._topic)
        self._subscriptions.append(topic.listen_on(node, self._hear))
        if OccupancyGridUpdate is not None:
            name, qos = f'{self._topic}_updates', QoSProfile(depth=10)
            listen = node.create_subscription(OccupancyGridUpdate, name, self._hear, qos)
            self._subscriptions.append(listen)

    @property
    def waiting(self) -> str:
        """Sentence on a missing map, '' if it is there."""
        return f'Waiting for a map on the topic {self._topic}.' if self.waits else ''

    def try_again(self) -> None:
        """Take a map for which there was no transform, if there is one by now."""
        if self._lacks_transform:
            self._take()

    def trouble(self, stamp: int) -> str:
        """Reason to stop at a time [ns]: the last map was refused, or its time is wrong, or ''."""
        age = (stamp - self._stamp) / NANOSECONDS
        if self.refusal or not self._topic or not 0.0 < self._timeout < abs(age):
            return self.refusal
        if age > 0.0:
            return f'The map is {age:.3f} s old (map.timeout).'
        of, odometry = self._stamp / NANOSECONDS, stamp / NANOSECONDS
        return (
            f'The map is of {of:.3f} s, {-age:.3f} s ahead of odometry of {odometry:.3f} s'
            ' (map.timeout); is use_sim_time right?'
        )

    def _hear(self, message: GridMessage | OccupancyGridUpdate) -> None:
        frame = message.header.frame_id
        try:
            if isinstance(message, GridMessage):
                self._grid = grid_of(message, frame, self._lethal)
            elif self._grid is not None and frame == self._frame:
                self._grid = updated(self._grid, message, self._lethal)
            else:
                return
        except ValueError as error:
            self._refuse('map', error)
            return
        self._frame, self._stamp = frame, stamp_of(message)
        self._take()

    def _take(self) -> None:
        """Make the map parameters, in the frame of the course by the latest transform."""
        grid, before = self._grid, self._lacks_transform
        assert grid is not None  # noqa: S101 (one has come)
        self._lacks_transform = False
        try:
            there = self._transforms.frame_pose(self._frame)
            self._change(
                {
                    'map.origin': compose(there, np.array(grid.origin)).tolist(),
                    'map.resolution': grid.resolution,
                    'map.cells': text_of(grid.cells),
                }
            )
        except TransformError as error:
            self._lacks_transform = True
            if not before:
                self._refuse('map', error)
        except ValueError as error:
            self._refuse('map', error)
