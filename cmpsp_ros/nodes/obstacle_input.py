"""What the guidance node hears of obstacles that move."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cmpsp_ros.guidance.odometry import stamp_of
from cmpsp_ros.guidance.tracks import TrackError, Tracks, check_age, tracks_of
from cmpsp_ros.nodes.topics import GUIDANCE_MOVING

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode
    from rclpy.subscription import Subscription
    from sensor_msgs.msg import PointCloud2

    from cmpsp_ros.guidance.settings import GuidanceSettings
    from cmpsp_ros.guidance.tracks import Track

_THROTTLE = 2.0


class ObstacleInput:
    """Listens, where plans have room for what moves, and keeps what is known.

    A message that cannot be used changes nothing: it is warned of, and what is known grows old.

    Attributes:
        settings: All settings of the guidance law, as they are now.
        subscription: Where it listens; None where plans have no room.
    """

    def __init__(self, node: LifecycleNode, settings: GuidanceSettings) -> None:
        """Open the topic, unless `moving_obstacles.capacity` is 0."""
        self.settings = settings
        self._node, self._tracks, self._refusal = node, Tracks(), ''
        self.subscription: Subscription | None = None
        if settings.moving_obstacles.capacity:
            self.subscription = GUIDANCE_MOVING.listen_on(node, self._hear)

    def at(self, stamp: int) -> tuple[Track, ...]:
        """What is known at a time [ns]."""
        if self.subscription is None:
            return ()
        return self._tracks.at(stamp, self.settings.moving_obstacles.timeout)

    def forget_after(self, stamp: int) -> None:
        """Time has jumped back to an instant [ns]: what was seen later is of another run."""
        self._tracks.forget_after(stamp)

    def warnings(self) -> list[str]:
        """Why the last message was refused, if it was."""
        return [self._refusal] if self._refusal else []

    def close(self) -> None:
        """Close the topic."""
        if self.subscription is not None:
            self._node.destroy_subscription(self.subscription)

    def _hear(self, message: PointCloud2) -> None:
        now = self._node.get_clock().now().nanoseconds
        try:
            tracks = tracks_of(message, self.settings.frame_id)
            check_age(stamp_of(message), now, self.settings.moving_obstacles.timeout)
        except TrackError as error:
            self._refusal = str(error)
            self._node.get_logger().warning(
                f'moving_obstacles refused: {error}', throttle_duration_sec=_THROTTLE
            )
        else:
            self._refusal = ''
            self._tracks.hear(tracks)
