"""The inputs of a law on a bag without decisions: odometry, scans or clouds, moving obstacles."""

from collections.abc import Iterator
from typing import Any

from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.inputs import Input, OdometryReceived, RunStarted
from cmpsp_ros.bags.replay.recording import OdometrySample
from cmpsp_ros.guidance import GuidanceSettings, messages
from cmpsp_ros.parameters import Values, guidance_settings
from cmpsp_ros.sensing import ScanError, Sensor, Surroundings, sight_of, stamp_of


class SensorInputs:
    """Inputs that a node with these parameters would have had; can be iterated over once.

    It decides as soon as all sensors have shown something, and not while one is silent. Raises
    BagError without odometry or a sensor.
    """

    def __init__(self, bag: Bag, names: Names, values: Values) -> None:
        self.values = values
        self._settings: GuidanceSettings = guidance_settings(values)
        self._bag, self._names, self._newest = bag, names, -1
        self._refused: dict[str, str] = {}
        self._check(names.odom, 'nav_msgs/msg/Odometry')
        self._sensors: dict[str, list[Sensor]] = {}
        for each in self._settings.sight.sensors:
            topic = each.topic_in(names.namespace)
            self._check(topic, each.message_type)
            self._sensors.setdefault(topic, []).append(each)

    def _check(self, topic: str, kind: str) -> None:
        if topic not in self._bag.topics or self._bag.topics[topic].msgtype != kind:
            raise self._bag.lacks(f'no topic {topic} of type {kind}')

    def __iter__(self) -> Iterator[Input]:
        """Iterate; raises `BagError` if the bag is damaged, or no odometry in it can be used."""
        settings, names = self._settings, self._names
        known = Surroundings(settings.sight, settings.robot_radius, settings.footprint)
        told, obstacles = messages.Tracks[messages.Track](), settings.moving_obstacles
        topics = [names.odom, *self._sensors]
        if obstacles.capacity and names.moving in self._bag.topics:
            topics.append(names.moving)
        yield RunStarted(self.values)
        is_used = False
        for topic, received, message in self._bag.together(topics):
            for sensor in self._sensors.get(topic, ()):
                try:
                    known.add(sight_of(message, sensor))
                except ScanError as error:
                    self._refused.setdefault(topic, str(error))
            try:
                if topic == names.moving:
                    told.add(messages.told_tracks_of(message, settings.frame_id))
                elif topic == names.odom and (odometry := self._odometry(received, message)):
                    stamp, pose = odometry.stamp, odometry.pose
                    known.update(stamp, pose)
                    if not known.blindness(stamp):
                        sighting, is_used = known.at(stamp, pose), True
                        seen = () if sighting is None else sighting.tracks
                        tracks = (*told.at(stamp, obstacles.timeout), *seen)
                        yield OdometryReceived(odometry, None, tracks=tracks, sighting=sighting)
            except (messages.OdometryError, messages.TrackError) as error:
                self._refused.setdefault(topic, str(error))
        if not is_used:
            why = '; '.join(f'{topic}: {why}' for topic, why in self._refused.items())
            why = why or 'the sensors show nothing at the times of odometry'
            raise self._bag.error(f'found nothing to decide on: {why}')

    def _odometry(self, received: int, message: Any) -> OdometrySample | None:
        """Odometry in the frame of the law; None if it is no newer than the last."""
        pose = messages.OdometryReading.of(message).pose_in(self._settings.frame_id)
        stamp = stamp_of(message)
        if stamp <= self._newest:
            return None
        self._newest = stamp
        return OdometrySample(received, stamp, pose)
