"""Objects of other trackers and detectors, and the fusion of all tracks."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from cmpsp_ros.bags import UnknownTypeError
from cmpsp_ros.guidance.messages import (
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
from cmpsp_ros.nodes.common.message_types import message_class
from cmpsp_ros.nodes.common.messages import cloud_of
from cmpsp_ros.nodes.common.topics import OWN_TRACKS, TRACKER
from cmpsp_ros.nodes.guidance.inputs.surroundings import ObstacleInput, SurroundingsInput
from cmpsp_ros.parameters import ParameterError, Problem
from cmpsp_ros.sensing import stamp_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.guidance import GuidanceSettings
    from cmpsp_ros.guidance.messages import MovingObject
    from cmpsp_ros.nodes.guidance.inputs.transforms import TransformInput
    from cmpsp_ros.sensing import Sighting, TrackSource

_FIRST = 2
"""Number of the first tracker; the tracks of own sensors have 1."""


class TrackerInput(SurroundingsInput):
    """Receives objects on the topics of `trackers.names`, and keeps the latest of each source.

    Attributes:
        settings: All settings of the guidance law, as they are now.
    """

    def __init__(
        self, node: LifecycleNode, settings: GuidanceSettings, transforms: TransformInput
    ) -> None:
        """Open the topics; raises ParameterError for types whose package is not installed."""
        super().__init__(node)
        self.settings, self._transforms = settings, transforms
        self._sources = settings.moving_obstacles.trackers
        types = [_class_of(each) for each in self._sources]
        self.forget()
        for number, (each, kind) in enumerate(zip(self._sources, types, strict=True)):
            topic = replace(TRACKER, name=each.topic, type=kind)
            hear = partial(self._hear, number)
            self._subscriptions.append(topic.listen_on(node, hear))

    def forget(self) -> None:
        """Forget everything: time has jumped back."""
        numbered = enumerate(self._sources, _FIRST)
        self._objects = [ObjectTracks(each, number) for number, each in numbered]
        self._tracks: list[Tracks[Track]] = [Tracks() for _ in self._sources]

    def at(self, stamp: int) -> list[tuple[Track, ...]]:
        """Tracks of each source that are known at a time [ns]."""
        self.drain()
        timeout = self.settings.moving_obstacles.timeout
        return [each.at(stamp, timeout) for each in self._tracks]

    def _hear(self, number: int, message: Any) -> None:
        source, timeout = self._sources[number], self.settings.moving_obstacles.timeout
        frame, stamp = message.header.frame_id, stamp_of(message)
        try:
            now = self._node.get_clock().now().nanoseconds
            check_track_age(message, now, timeout, 'Objects are')
            with_motion = is_relative(source.type)
            there, motion = self._transforms.frame_at(frame, stamp, with_motion=with_motion)
            tracks = self._objects[number].tracks_of(message, there, motion, timeout)
        except TrackError as error:
            said = f'A message of tracker {source.name} is refused: {error}'
            self._refuse(source.name, said, said)
        else:
            self._refusals[source.name] = ''
            self._tracks[number].add(tracks)


class TrackInput:
    """Fuses the tracks of all sources, and publishes those that a decision uses.

    Tracks that `moving_obstacles` brings are in the bag already.
    """

    def __init__(
        self, node: LifecycleNode, settings: GuidanceSettings, transforms: TransformInput
    ) -> None:
        """Open the topics; raises ParameterError for types whose package is not installed."""
        self._node, self._frame_id = node, settings.frame_id
        self._obstacles = ObstacleInput(node, settings, transforms)
        self._trackers = TrackerInput(node, settings, transforms)
        self._fusion, self._published = TrackFusion(), dict[int, int]()
        has_more = settings.sight.sensors or settings.moving_obstacles.trackers
        self._publisher = OWN_TRACKS.publish_on(node) if has_more else None

    def at(self, stamp: int, sighting: Sighting | None) -> tuple[MovingObject, ...]:
        """Everything known to move at a time [ns]: each object once, then robots by name."""
        known = self._obstacles.at(stamp)
        if self._publisher is None:
            return known
        told = [each for each in known if isinstance(each, Track)]
        robots = [each for each in known if isinstance(each, PeerTrajectory)]
        radius = self._obstacles.settings.moving_obstacles.others_radius
        seen = () if sighting is None else sighting.tracks
        others = [
            without_robots(each, robots, radius, stamp)
            for each in (seen, *self._trackers.at(stamp))
        ]
        fused = self._fusion.update(stamp, (told, *others))
        self._publish([each for each in fused if each not in told])
        return (*fused, *robots)

    def take(self, settings: GuidanceSettings) -> None:
        """Take other settings."""
        self._obstacles.settings = self._trackers.settings = settings

    def warnings(self, now: int) -> list[str]:
        """Refusals of the last messages, and robots silent at a time [ns]."""
        return [*self._obstacles.warnings(now), *self._trackers.refusals]

    def forget_after(self, stamp: int) -> None:
        """Time has jumped back to an instant [ns]: later reports are of another run."""
        self._obstacles.forget_after(stamp)
        self._trackers.forget()
        self._fusion, self._published = TrackFusion(), {}

    def close(self) -> None:
        """Close the topics."""
        self._obstacles.close()
        self._trackers.close()
        if self._publisher is not None:
            self._node.destroy_publisher(self._publisher)

    def _publish(self, tracks: Sequence[Track]) -> None:
        """Publish tracks that were not published before; those of one time in one message."""
        assert self._publisher is not None  # noqa: S101 (tracks have come)
        new = sorted(each for each in tracks if self._published.get(each.id) != each.stamp)
        self._published = {each.id: each.stamp for each in tracks}
        for stamp in sorted({each.stamp for each in new}):
            some = [each for each in new if each.stamp == stamp]
            self._publisher.publish(cloud_of(some, stamp, self._frame_id))


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
