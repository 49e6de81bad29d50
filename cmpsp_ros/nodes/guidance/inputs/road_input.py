"""Roads that other programs tell the guidance node."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cmpsp_ros.nodes.common.parameters import change_parameters
from cmpsp_ros.nodes.common.topics import GUIDANCE_ROAD

if TYPE_CHECKING:
    from nav_msgs.msg import Path
    from rclpy.lifecycle import LifecycleNode
    from rclpy.subscription import Subscription

    from cmpsp_ros.nodes.guidance.inputs.transform_input import TransformInput
    from cmpsp_ros.parameters import Values


class RoadInput:
    """Listens, where `road.source` is `topic`, and makes each road a change of parameters.

    So it is checked with the whole set, takes effect between two control steps and is recorded, as
    any live change. One that is refused changes nothing.

    Attributes:
        waits: Whether the first road is still to come.
        refusal: Why the last road was refused, if it was.
    """

    def __init__(self, node: LifecycleNode, values: Values, transforms: TransformInput) -> None:
        """Open the topic, where there is to be one.

        Args:
            node: Holds the parameters.
            values: Of the node, as it was configured with them.
            transforms: Lead to the frame of the course.
        """
        self._node, self._transforms = node, transforms
        self.waits, self.refusal = values['road.source'] == 'topic', ''
        self._subscription: Subscription | None = None
        if self.waits:
            self._subscription = GUIDANCE_ROAD.listen_on(node, self._hear)
            node.get_logger().info('waiting for a road on the topic road')

    def close(self) -> None:
        """Close the topic."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)

    def drive_along(self, path: Path) -> tuple[float, float]:
        """Take the path of an action for the road, and its end for the goal, which is returned.

        Raises:
            ValueError: It cannot be that; nothing changes.
        """
        if self._subscription is None:
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
            self.refusal = f'The road that came is refused: {" ".join(str(error).splitlines())}.'
            self._node.get_logger().error(self.refusal)

    def _take(self, changes: dict[str, Any]) -> None:
        """Change the parameters.

        Raises:
            ValueError: They are refused.
        """
        change_parameters(self._node, changes)
        self.waits, self.refusal = False, ''
        count = len(changes['road.points']) // 2
        self._node.get_logger().info(f'a road of {count} points has come')
