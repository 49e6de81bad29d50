"""Sensors, moving obstacles, other robots and trackers, as the guidance node receives them.

An unusable message changes nothing: a warning is given, and the known state grows old.
"""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Path
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import LaserScan, PointCloud2

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags import UnknownTypeError
from cmpsp_ros.guidance import NANOSECONDS, NEVER, GuidanceSettings, to_nanoseconds
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
from cmpsp_ros.nodes.common import topics
from cmpsp_ros.nodes.common.messages import cloud_of, set_stamp
from cmpsp_ros.nodes.common.topic import Listener, Topic, message_class
from cmpsp_ros.nodes.guidance.inputs.transforms import TransformInput
from cmpsp_ros.parameters import ParameterError, Problem
from cmpsp_ros.sensing import (
    REMEMBERED,
    ScanError,
    Sensor,
    Sighting,
    Surroundings,
    TrackSource,
    sight_of,
    stamp_of,
)
from cmpsp_ros.world.grids import Cell

_THROTTLE = 2.0
_FIRST = 2  # number of the first tracker; the tracks of own sensors have 1
_MESSAGES = {'scan': LaserScan, 'cloud': PointCloud2}

# Values of a nav_msgs/OccupancyGrid by `Cell`.
_VALUES = np.zeros(len(Cell), dtype=np.int8)
_VALUES[[Cell.OCCUPIED, Cell.UNKNOWN, Cell.REMEMBERED]] = 100, -1, REMEMBERED


class SurroundingsInput(Listener):
    """Topics whose last message may have been refused."""

    def __init__(self, node: LifecycleNode) -> None:
        super().__init__(node)
        self._refusals: dict[int, str] = {}

    def _listen(self, topic: Topic, read: Callable[[Any], None], reason: str = '{}') -> None:
        """Read messages of a topic; `reason` says in diagnostics why one was refused."""
        hear = partial(self._hear, len(self._subscriptions), topic.name, read, reason)
        self._subscriptions.append(topic.listen_on(self._node, hear))

    def _hear(
        self, number: int, topic: str, read: Callable[[Any], None], reason: str, message: Any
    ) -> None:
        try:
            read(message)
        except (ScanError, TrackError) as error:
            self._refusals[number] = said = reason.format(error)
            said = f'{topic} refused: {error}' if reason == '{}' else said
            self._node.get_logger().warning(said, throttle_duration_sec=_THROTTLE)
        else:
            self._refusals[number] = ''

    @property
    def refusals(self) -> list[str]:
        """Reasons why last messages were refused."""
        return [each for each in self._refusals.values() if each]


class SensorInput(SurroundingsInput):
    """Listens to all sensors, and publishes the grid that a decision used."""

    def __init__(self, node: LifecycleNode, settings: GuidanceSettings) -> None:
        super().__init__(node)
        self._frame_id = settings.frame_id
        footprint = settings.robot_radius, settings.footprint
        self._surroundings = Surroundings(settings.sight, *footprint)
        self._sensors = settings.sight.sensors
        for each in self._sensors:
            topic = replace(topics.SCAN, name=each.topic, type=_MESSAGES[each.type])
            reason = 'A message of a sensor is refused: {}.'
            self._listen(topic, partial(self._read, each), reason)
        self.publisher = self._publish_on(topics.SIGHTING) if self._sensors else None
        self._unpublished: Sighting | None = None

    def note(self, stamp: int, pose: Array) -> str:
        """Note a pose ``(3,)`` [m, m, rad] of odometry; reason to stop if a sensor is blind."""
        if not self._sensors:
            return ''
        self.drain()
        self._surroundings.update(stamp, pose)
        blind = self._surroundings.blindness(stamp)
        return ' '.join([blind, *self.refusals]) if blind else ''

    def at(self, stamp: int, pose: Array) -> Sighting | None:
        """The grid at the latest odometry, and the tracks."""
        sighting = self._surroundings.at(stamp, pose)
        if sighting is not None and sighting.stamp == stamp:
            self._unpublished = sighting
        return sighting

    def publish(self) -> None:
        """Publish the grid of the last decision, if it was a new one."""
        if self.publisher is not None and self._unpublished is not None:
            self.publisher.publish(self._message(self._unpublished))
            self._unpublished = None

    def forget(self) -> None:
        """Forget everything: time has jumped back."""
        self._surroundings.forget()

    def warnings(self) -> list[str]:
        """Refusals of last messages."""
        return self.refusals

    def _read(self, sensor: Sensor, message: Any) -> None:
        self._surroundings.add(sight_of(message, sensor))

    def _message(self, sighting: Sighting) -> GridMessage:
        grid, message = sighting.grid, GridMessage()
        set_stamp(message.header, sighting.stamp)
        message.header.frame_id = self._frame_id
        message.info.resolution = grid.resolution
        message.info.height, message.info.width = grid.cells.shape
        x, y, _ = grid.origin
        message.info.origin.position.x, message.info.origin.position.y = x, y
        message.info.origin.orientation.w = 1.0
        message.data = array('b', _VALUES[grid.cells].tobytes())
        return message


class TrackInput(SurroundingsInput):
    """Receives tracks of all sources, fuses them, and publishes those that a decision used.

    Tracks that `moving_obstacles` brings are in the bag already. Raises ParameterError for
    types whose package is not installed.
    """

    def __init__(
        self, node: LifecycleNode, settings: GuidanceSettings, transforms: TransformInput
    ) -> None:
        super().__init__(node)
        self.settings, self._transforms = settings, transforms
        known, own = settings.moving_obstacles, node.get_namespace()
        self._trackers = [
            (each, replace(topics.TRACKER, name=each.topic, type=_class_of(each)))
            for each in known.trackers
        ]
        self._obstacles, self._plans = Tracks[Track](), Tracks[PeerTrajectory]()
        # Tracks that the last decision used, without those told on `moving_obstacles`.
        self._used: list[Track] = []
        self._published: dict[int, int] = {}
        self.forget_after(NEVER)
        if known.capacity:
            self._listen(topics.GUIDANCE_MOVING, self._read_obstacles)
        for each in known.others:
            if each != own:
                self._listen(topics.plans_of(each), partial(self._read_plan, each))
        for number, (source, topic) in enumerate(self._trackers):
            reason = f'A message of tracker {source.name} is refused: {{}}'
            self._listen(topic, partial(self._read_objects, number), reason)
        has_more = settings.sight.sensors or known.trackers
        self.publisher = self._publish_on(topics.OWN_TRACKS) if has_more else None

    def at(self, stamp: int, sighting: Sighting | None) -> tuple[MovingObject, ...]:
        """Everything known to move at a time [ns]: each object once, then robots by name."""
        self.drain()
        known = self.settings.moving_obstacles
        told = self._obstacles.at(stamp, known.timeout)
        robots = self._plans.at(stamp, known.timeout)
        if self.publisher is None:
            return (*told, *robots)
        seen = () if sighting is None else sighting.tracks
        others = [
            without_robots(each, robots, known.others_radius, stamp)
            for each in (seen, *(each.at(stamp, known.timeout) for each in self._tracks))
        ]
        fused = self._fusion.update(stamp, (told, *others))
        self._used = [each for each in fused if each not in told]
        return (*fused, *robots)

    def publish(self) -> None:
        """Publish new tracks of the last decision, a message for each stamp."""
        if self.publisher is None:
            return
        new = sorted(each for each in self._used if self._published.get(each.id) != each.stamp)
        self._published = {each.id: each.stamp for each in self._used}
        for stamp in sorted({each.stamp for each in new}):
            some = [each for each in new if each.stamp == stamp]
            self.publisher.publish(cloud_of(some, stamp, self.settings.frame_id))

    def warnings(self, now: int) -> list[str]:
        """Refusals of the last messages, and robots and trackers silent at a time [ns]."""
        timeout = self.settings.moving_obstacles.timeout
        oldest = now - round(timeout * NANOSECONDS)
        lost = [name for name, each in self._heard.items() if each.is_older(oldest)]
        said = [f'Not kept clear of, for no plan comes: {", ".join(lost)}.'] if lost else []
        silent = [name for name, stamp in self._received.items() if stamp < oldest]
        if silent:
            unheard = f'No message for more than {timeout:.3g} s (moving_obstacles.timeout)'
            said.append(f'{unheard} from {", ".join(silent)}.')
        return [*self.refusals, *said]

    def forget_after(self, stamp: int) -> None:
        """Time has jumped back to an instant [ns]: later reports are of another run."""
        self._obstacles.forget_after(stamp)
        self._plans.forget_after(stamp)
        # Robots never heard of cannot be missing.
        self._heard: dict[str, PeerTrajectory] = {}
        # Times of the last messages [ns]; `moving_obstacles` need not be in use.
        self._received = {f'tracker {each.name}': -NEVER for each, _ in self._trackers}
        self._objects = [ObjectTracks(e, n) for n, (e, _) in enumerate(self._trackers, _FIRST)]
        self._tracks: list[Tracks[Track]] = [Tracks() for _ in self._trackers]
        self._fusion, self._published = TrackFusion(), {}
        self._used = []

    def _read_obstacles(self, message: PointCloud2) -> None:
        tracks = self._transforms.tracks_of(message)
        self._check_age(message, 'Obstacles are')
        self._add(self._obstacles, tracks)
        self._received['moving_obstacles'] = self._now()

    def _read_plan(self, namespace: str, message: Path) -> None:
        plan = PeerTrajectory.of(message, namespace, self.settings.frame_id)
        self._check_age(message, f'The plan of {namespace} is')
        self._add(self._plans, [plan])
        self._heard[namespace] = plan

    def _read_objects(self, number: int, message: Any) -> None:
        self._check_age(message, 'Objects are')
        is_moving = is_relative(self._trackers[number][0].type)
        frame, stamp = message.header.frame_id, stamp_of(message)
        there, motion = self._transforms.frame_at(frame, stamp, with_motion=is_moving)
        timeout = self.settings.moving_obstacles.timeout
        tracks = self._objects[number].tracks_of(message, there, motion, timeout)
        self._add(self._tracks[number], tracks)
        self._received[f'tracker {self._trackers[number][0].name}'] = self._now()

    def _add(self, known: Tracks[Any], reports: Sequence[MovingObject]) -> None:
        """Add the reports of a message; forget those too old for any step: there may be none."""
        known.add(reports)
        timeout = self.settings.moving_obstacles.timeout
        # Stamps may be ahead of the clock, and odometry behind it.
        lead = to_nanoseconds(timeout + self.settings.odom_timeout)
        for each in reports[:1]:
            known.forget_before(each.stamp - lead, timeout)

    def _check_age(self, message: Any, subject: str) -> None:
        check_track_age(message, self._now(), self.settings.moving_obstacles.timeout, subject)

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)


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
