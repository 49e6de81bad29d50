"""Roads that other programs tell the guidance node."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.parameter import Parameter

from cmpsp_ros.nodes.common.topics import GUIDANCE_ROAD
from cmpsp_ros.parameters.errors import ParameterError

if TYPE_CHECKING:
    from nav_msgs.msg import Path
    from rclpy.lifecycle import LifecycleNode
    from rclpy.subscription import Subscription

    from cmpsp_ros.nodes.guidance.transform_input import TransformInput
    from cmpsp_ros.parameters.table import Values


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

    def _hear(self, message: Path) -> None:
        try:
            changes = self._transforms.road_in(message)
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
