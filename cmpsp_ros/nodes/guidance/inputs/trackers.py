"""Moving obstacles, plans of other robots, and objects of trackers: received and fused."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from nav_msgs.msg import Path
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import PointCloud2

from cmpsp_ros.bags import UnknownTypeError
from cmpsp_ros.guidance import NANOSECONDS, NEVER, GuidanceSettings
from cmpsp_ros.guidance.messages import (
    MovingObject,
    ObjectTracks,
    PeerTrajectory,
    Track,
    TrackError,
    TrackFusion,
    Tracks,
    check_track_age,
    is_relative,
    without_robots,
)
from cmpsp_ros.nodes.common.messages import cloud_of
from cmpsp_ros.nodes.common.topic import message_class
from cmpsp_ros.nodes.common.topics import GUIDANCE_MOVING, OWN_TRACKS, TRACKER, Topic, plans_of
from cmpsp_ros.nodes.guidance.inputs.surroundings import SurroundingsInput
from cmpsp_ros.nodes.guidance.inputs.transforms import TransformInput
from cmpsp_ros.parameters import ParameterError, Problem
from cmpsp_ros.sensing import Sighting, TrackSource, stamp_of

_FIRST = 2
"""Number of the first tracker; the tracks of own sensors have 1."""


class TrackInput(SurroundingsInput):
    """Receives tracks of all sources, fuses them, and publishes those that a decision uses.

    Tracks that `moving_obstacles` brings are in the bag already.

    Attributes:
        settings: All settings of the guidance law, as they are now.
    """

    def __init__(
        self, node: LifecycleNode, settings: GuidanceSettings, transforms: TransformInput
    ) -> None:
        """Open the topics; raises ParameterError for types whose package is not installed."""
        super().__init__(node)
        self.settings, self._transforms = settings, transforms
        known, own = settings.moving_obstacles, node.get_namespace()
        self._trackers = [
            (each, replace(TRACKER, name=each.topic, type=_class_of(each)))
            for each in known.trackers
        ]
        self._obstacles, self._plans = Tracks[Track](), Tracks[PeerTrajectory]()
        self.forget_after(NEVER)
        if known.capacity:
            self._listen(GUIDANCE_MOVING, self._read_obstacles)
        for each in known.others:
            if each != own:
                self._listen(plans_of(each), partial(self._read_plan, each))
        for number, (source, topic) in enumerate(self._trackers):
            said = f'A message of tracker {source.name} is refused: '
            self._listen(topic, partial(self._read_objects, number), said)
        has_more = settings.sight.sensors or known.trackers
        self._publisher = OWN_TRACKS.publish_on(node) if has_more else None

    def at(self, stamp: int, sighting: Sighting | None) -> tuple[MovingObject, ...]:
        """Everything known to move at a time [ns]: each object once, then robots by name."""
        self.drain()
        known = self.settings.moving_obstacles
        told = self._obstacles.at(stamp, known.timeout)
        robots = self._plans.at(stamp, known.timeout)
        if self._publisher is None:
            return (*told, *robots)
        seen = () if sighting is None else sighting.tracks
        others = [
            without_robots(each, robots, known.others_radius, stamp)
            for each in (seen, *(each.at(stamp, known.timeout) for each in self._tracks))
        ]
        fused = self._fusion.update(stamp, (told, *others))
        self._publish([each for each in fused if each not in told])
        return (*fused, *robots)

    def warnings(self, now: int) -> list[str]:
        """Refusals of the last messages, and robots silent at a time [ns]."""
        oldest = now - round(self.settings.moving_obstacles.timeout * NANOSECONDS)
        silent = [name for name, each in self._heard.items() if each.is_older(oldest)]
        lost = [f'Not kept clear of, for no plan comes: {", ".join(silent)}.'] if silent else []
        return [*self.refusals, *lost]

    def forget_after(self, stamp: int) -> None:
        """Time has jumped back to an instant [ns]: later reports are of another run."""
        self._obstacles.forget_after(stamp)
        self._plans.forget_after(stamp)
        # Robots never heard of cannot be missing.
        self._heard: dict[str, PeerTrajectory] = {}
        self._objects = [ObjectTracks(e, n) for n, (e, _) in enumerate(self._trackers, _FIRST)]
        self._tracks: list[Tracks[Track]] = [Tracks() for _ in self._trackers]
        self._fusion, self._published = TrackFusion(), dict[int, int]()

    def close(self) -> None:
        """Close the topics."""
        super().close()
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)

    def _listen(self, topic: Topic, read: Callable[[Any], None], said: str = '') -> None:
        hear = partial(self._hear, topic.name, read, said)
        self._subscriptions.append(topic.listen_on(self._node, hear))

    def _hear(self, topic: str, read: Callable[[Any], None], said: str, message: Any) -> None:
        try:
            read(message)
        except TrackError as error:
            self._refuse(topic, f'{said}{error}', f'{said or f"{topic} refused: "}{error}')
        else:
            self._refusals[topic] = ''

    def _read_obstacles(self, message: PointCloud2) -> None:
        tracks = self._transforms.tracks_of(message)
        self._check_age(message, 'Obstacles are')
        self._obstacles.add(tracks)

    def _read_plan(self, namespace: str, message: Path) -> None:
        plan = PeerTrajectory.of(message, namespace, self.settings.frame_id)
        self._check_age(message, f'The plan of {namespace} is')
        self._plans.add([plan])
        self._heard[namespace] = plan

    def _read_objects(self, number: int, message: Any) -> None:
        self._check_age(message, 'Objects are')
        is_moving = is_relative(self._trackers[number][0].type)
        frame, stamp = message.header.frame_id, stamp_of(message)
        there, motion = self._transforms.frame_at(frame, stamp, with_motion=is_moving)
        timeout = self.settings.moving_obstacles.timeout
        tracks = self._objects[number].tracks_of(message, there, motion, timeout)
        self._tracks[number].add(tracks)

    def _check_age(self, message: Any, subject: str) -> None:
        now = self._node.get_clock().now().nanoseconds
        check_track_age(message, now, self.settings.moving_obstacles.timeout, subject)

    def _publish(self, tracks: Sequence[Track]) -> None:
        """Publish tracks that were not published before; those of one time in one message."""
        assert self._publisher is not None  # noqa: S101 (tracks have come)
        new = sorted(each for each in tracks if self._published.get(each.id) != each.stamp)
        self._published = {each.id: each.stamp for each in tracks}
        for stamp in sorted({each.stamp for each in new}):
            some = [each for each in new if each.stamp == stamp]
            self._publisher.publish(cloud_of(some, stamp, self.settings.frame_id))


def _class_of(source: TrackSource) -> Any:
    """Message class of a source; raises ParameterError."""
    try:
        return message_class(source.type)
    except UnknownTypeError:
        package = source.type.partition('/')[0]
        key, found = f'trackers.{source.name}.type', f'{source.type!r}'
        name = f'ros-$ROS_DISTRO-{package.replace("_", "-")}'
        wanted = f'the package {package} to be installed, as by apt install {name}'
        raise ParameterError(Problem(key, found, wanted)) from None
