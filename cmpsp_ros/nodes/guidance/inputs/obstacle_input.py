"""What the guidance node hears of all that moves: obstacles, and plans of other robots."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import PeerTrajectory, TrackError, Tracks, check_track_age
from cmpsp_ros.nodes.common.topics import GUIDANCE_MOVING, plans_of
from cmpsp_ros.nodes.timing.drain_queue import drain_queue

if TYPE_CHECKING:
    from nav_msgs.msg import Path
    from rclpy.lifecycle import LifecycleNode
    from rclpy.subscription import Subscription
    from sensor_msgs.msg import PointCloud2

    from cmpsp_ros.guidance import GuidanceSettings
    from cmpsp_ros.guidance.messages import MovingObject, Track
    from cmpsp_ros.nodes.guidance.inputs.transform_input import TransformInput

_THROTTLE = 2.0


class ObstacleInput:
    """Listens, where plans have room for what moves, and keeps what is known.

    A message that cannot be used changes nothing: it is warned of, and what is known grows old.

    Attributes:
        settings: All settings of the guidance law, as they are now.
    """

    def __init__(
        self, node: LifecycleNode, settings: GuidanceSettings, transforms: TransformInput
    ) -> None:
        """Open the topics: of obstacles unless `moving_obstacles.capacity` is 0, and of others."""
        self.settings, self._transforms = settings, transforms
        self._node, self._refusals = node, dict[str, str]()
        self._tracks: Tracks[Track] = Tracks()
        self._plans: Tracks[PeerTrajectory] = Tracks()
        # When each was heard of last; those that never were are none to miss.
        self._heard: dict[str, PeerTrajectory] = {}
        self._subscriptions: tuple[Subscription, ...] = ()
        known, own = settings.moving_obstacles, node.get_namespace()
        if known.capacity:
            self._subscriptions += (GUIDANCE_MOVING.listen_on(node, self._hear),)
        self._subscriptions += tuple(
            plans_of(each).listen_on(node, partial(self._hear_plan, each))
            for each in known.others
            if each != own
        )

    def at(self, stamp: int) -> tuple[MovingObject, ...]:
        """What is known at a time [ns]: obstacles by their numbers, then robots by their names."""
        if not self._subscriptions:
            return ()
        for each in self._subscriptions:
            drain_queue(each)
        timeout = self.settings.moving_obstacles.timeout
        return (*self._tracks.at(stamp, timeout), *self._plans.at(stamp, timeout))

    def forget_after(self, stamp: int) -> None:
        """Time has jumped back to an instant [ns]: what was seen later is of another run."""
        self._tracks.forget_after(stamp)
        self._plans.forget_after(stamp)
        self._heard = {}

    def warnings(self, now: int) -> list[str]:
        """Why the last message was refused, if it was; and who is not heard of at a time [ns]."""
        oldest = now - round(self.settings.moving_obstacles.timeout * NANOSECONDS)
        silent = [name for name, each in self._heard.items() if each.is_older(oldest)]
        lost = [f'Not kept clear of, for no plan comes: {", ".join(silent)}.'] if silent else []
        return [*filter(None, self._refusals.values()), *lost]

    def close(self) -> None:
        """Close the topics."""
        for each in self._subscriptions:
            self._node.destroy_subscription(each)

    def _hear(self, message: PointCloud2) -> None:
        try:
            tracks = self._transforms.tracks_of(message)
            self._check_age(message, 'Obstacles are')
        except TrackError as error:
            self._refuse(GUIDANCE_MOVING.name, error)
        else:
            self._refusals[GUIDANCE_MOVING.name] = ''
            self._tracks.add(tracks)

    def _hear_plan(self, namespace: str, message: Path) -> None:
        try:
            plan = PeerTrajectory.of(message, namespace, self.settings.frame_id)
            self._check_age(message, f'The plan of {namespace} is')
        except TrackError as error:
            self._refuse(plans_of(namespace).name, error)
        else:
            self._refusals[plans_of(namespace).name] = ''
            self._plans.add([plan])
            self._heard[namespace] = plan

    def _check_age(self, message: PointCloud2 | Path, what: str) -> None:
        now = self._node.get_clock().now().nanoseconds
        check_track_age(message, now, self.settings.moving_obstacles.timeout, what)

    def _refuse(self, topic: str, error: TrackError) -> None:
        self._refusals[topic] = str(error)
        self._node.get_logger().warning(
            f'{topic} refused: {error}', throttle_duration_sec=_THROTTLE
        )
