"""Roads between nodes: the input of the guidance node and the output of the simulator."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.parameter import Parameter

from cmpsp_ros.nodes.common.topics import GUIDANCE_ROAD
from cmpsp_ros.parameters.courses.road_messages import road_in
from cmpsp_ros.parameters.errors import ParameterError

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode
    from rclpy.subscription import Subscription

    from cmpsp_ros.parameters.table import Values


class RoadInput:
    """Subscribes to roads where `road.source` is `topic`, and sets each as parameters.

    So a road is checked with the whole set, takes effect between two control steps and is recorded
    like any live change. A refused road changes nothing.

    Attributes:
        waits: Whether no road has been received yet.
        refusal: Why the last road was refused, if it was.
    """

    def __init__(self, node: LifecycleNode, values: Values) -> None:
        """Open the topic, where there is to be one.

        Args:
            node: Holds the parameters.
            values: Of the node, as it was configured with them.
        """
        self._node, self._frame_id = node, values['frame_id']
        self.waits, self.refusal = values['road.source'] == 'topic', ''
        self._subscription: Subscription | None = None
        if self.waits:
            self._subscription = GUIDANCE_ROAD.listen_on(node, self._hear)
            node.get_logger().info('waiting for a road on the topic road')

    def close(self) -> None:
        """Close the topic."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)

    def _hear(self, message: Path) -> None:
        try:
            changes = road_in(message, self._frame_id)
        except ParameterError as error:
            self._refuse(str(error))
            return
        known = {key: self._node.get_parameter(key).value for key in changes}
        if changes != {**known, 'road.points': list(known['road.points'] or ())}:
            outcome = self._node.set_parameters_atomically(
                [Parameter(key, value=value) for key, value in changes.items()]
            )
            if not outcome.successful:
                self._refuse(outcome.reason)
                return
        self.waits, self.refusal = False, ''
        self._node.get_logger().info(f'a road of {len(message.poses)} points has come')

    def _refuse(self, reason: str) -> None:
        self.refusal = f'The road that came is refused: {" ".join(reason.splitlines())}.'
        self._node.get_logger().error(self.refusal)


def path_of(values: Values) -> Path:
    """The message of a corridor; `cmpsp_ros.parameters.courses.road_messages` reads it.

    Args:
        values: Parameters with at least one point.
    """
    numbers = values['road.points']
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    message = Path()
    message.header.frame_id = values['frame_id']
    for x, y in [*points, *(points[:1] if values['road.closed'] else ())]:
        pose = PoseStamped(header=message.header)
        pose.pose.position.x, pose.pose.position.y = x, y
        message.poses.append(pose)
    return message
