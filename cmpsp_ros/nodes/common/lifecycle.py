"""Lifecycle nodes that tolerate invalid requests."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lifecycle_msgs.srv import ChangeState
from rclpy.impl.implementation_singleton import rclpy_implementation

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = 'unconfigured', 'inactive', 'active', 'finalized'
"""States of a lifecycle node."""


def guard_change_state(node: LifecycleNode) -> None:
    """Make `~/change_state` answer `success=False` to a transition that is not possible now.

    rclpy raises an exception for such a request by id, which ends the process: any client could end
    a moving robot's node by a mistyped number.

    Args:
        node: Lifecycle node with its communication interface enabled; call this once, in the
            constructor.
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
