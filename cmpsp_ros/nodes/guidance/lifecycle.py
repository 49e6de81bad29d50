"""Lifecycle of the guidance node: invalid requests tolerated, and Nav2's heartbeat kept up."""

from uuid import uuid4

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.timer import Timer

from cmpsp_ros.nodes.common.topic import steady_timer

try:
    from bond.msg import Status
except ImportError:  # bond is not among the wheels
    Status = None

# States of a lifecycle node.
UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = 'unconfigured', 'inactive', 'active', 'finalized'
_TOPIC, _DEPTH = 'bond', 10
_PERIOD, _TIMEOUT = 0.1, 4.0


def guard_change_state(node: LifecycleNode) -> None:
    """Make `~/change_state` refuse a transition that is not possible now.

    rclpy raises an exception for such a request by id, which would end a moving robot's node.
    """
    service = next(each for each in node.services if each.srv_type is ChangeState)
    change_state = service.callback

    def guarded(
        request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        try:
            return change_state(request, response)
        except rclpy_implementation.RCLError as error:
            wanted = request.transition.label or f'id {request.transition.id}'
            reason = ' '.join(str(error).split())
            node.get_logger().error(f'lifecycle transition {wanted} refused: {reason}')
            response.success = False
            return response

    service.callback = guarded


class LifecycleBond:
    """This node's side of a bond; the manager's is not waited for, and may be missing."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._timer: Timer | None = None
        if Status is not None:
            self._publisher = node.create_publisher(Status, _TOPIC, _DEPTH)
            self._message = Status(
                id=node.get_name(), heartbeat_period=_PERIOD, heartbeat_timeout=_TIMEOUT
            )

    def begin(self) -> None:
        """The node is active."""
        if Status is None:
            return
        # One that ends is over for good: each needs another name.
        self._message.instance_id, self._message.active = str(uuid4()), True
        self._timer = steady_timer(self._node, _PERIOD, self._beat)
        self._beat()

    def end(self) -> None:
        """It is not any more; this is no failure."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer, self._message.active = None, False
            self._beat()

    def _beat(self) -> None:
        self._message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(self._message)
