"""Odometry in another frame than the course, by the transforms on `/tf`."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.qos import DurabilityPolicy, QoSProfile

from cmpsp_ros.guidance.messages.odometry import OdometryError, pose_of, stamp_of
from cmpsp_ros.guidance.messages.transforms import TransformError, Transforms, compose
from cmpsp_ros.nodes.timing.drain_queue import drain_queue

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # tf2 is not among the wheels
    TFMessage = None

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rclpy.lifecycle import LifecycleNode

_DEPTH = 100


class TransformInput:
    """Listens to transforms from when odometry first comes in another frame."""

    def __init__(self, node: LifecycleNode) -> None:
        """Wait for such odometry."""
        self._node = node
        self._transforms = Transforms()
        self._subscriptions: list[Any] = []

    def pose_of(
        self, message: Any, frame_id: str, timeout: float
    ) -> tuple[NDArray[np.float64], bool]:
        """Pose of odometry in a frame, and whether it took a transform.

        Args:
            message: With a header and a pose.
            frame_id: The frame wanted.
            timeout: How far from its time the nearest transform may be [s].

        Raises:
            OdometryError: It cannot be used, or there is no transform.
        """
        found = message.header.frame_id
        if found == frame_id:
            return pose_of(message, frame_id), False
        why = 'tf2_msgs, for a transform, is not installed'
        if TFMessage is not None:
            self._listen()
            try:
                there = self._transforms.look_up(frame_id, found, stamp_of(message), timeout)
                return compose(there, pose_of(message, found)), True
            except TransformError as error:
                why = str(error)
        raise OdometryError(
            f'Odometry is in frame {found!r}, wanted {frame_id!r} (frame_id): {why}.'
        )

    def close(self) -> None:
        """Close the topics."""
        for each in self._subscriptions:
            self._node.destroy_subscription(each)

    def _listen(self) -> None:
        if not self._subscriptions:
            for topic, is_static in (('/tf', False), ('/tf_static', True)):
                latched = DurabilityPolicy.TRANSIENT_LOCAL
                durability = latched if is_static else DurabilityPolicy.VOLATILE
                hear = partial(self._transforms.hear, is_static=is_static)
                qos = QoSProfile(depth=_DEPTH, durability=durability)
                subscription = self._node.create_subscription(TFMessage, topic, hear, qos)
                self._subscriptions.append(subscription)
        for each in self._subscriptions:
            drain_queue(each)
