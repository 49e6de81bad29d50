"""A moving object as somebody saw it: position, velocity, and their standard deviations."""

from dataclasses import dataclass
from typing import ClassVar, Literal

from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, setting


@dataclass(frozen=True, order=True)
class Track:
    """A moving obstacle as it was seen; of two at one time the greater counts."""

    FIELDS: ClassVar = ('x', 'y', 'vx', 'vy', 'radius')
    """Fields of a message that are floats of either length."""
    SEEN: ClassVar = 2**24
    """Number of the first that own sensors have seen; those told on a topic have smaller ones."""
    DOUBTS: ClassVar = ('position_stddev', 'velocity_stddev')
    """Further ones, which a message may lack: then they are 0."""

    id: int  # its number, the same in each message
    stamp: int  # time at which it was seen [ns]
    radius: float  # [m]
    x: float  # centre [m]
    y: float  # centre [m]
    vx: float  # velocity [m/s]
    vy: float  # velocity [m/s]
    position_stddev: float = 0.0  # standard deviation of the centre, along its worst axis [m]
    velocity_stddev: float = 0.0  # standard deviation of the velocity, along its worst axis [m/s]

    @property
    def name(self) -> str:
        """Name in messages."""
        source, number = divmod(self.id, self.SEEN)
        if self.is_seen:
            return f'person {number}'
        if source > 1:
            return f'object {number} of tracker {source - 1}'
        return f'moving obstacle {self.id}'

    @property
    def is_seen(self) -> bool:
        """True if own sensors have seen it."""
        return self.SEEN <= self.id < 2 * self.SEEN

    @property
    def key(self) -> tuple[int, int]:
        """Number and stamp, by which a decision refers to it."""
        return self.id, self.stamp

    def is_older(self, stamp: int) -> bool:
        """True if it was seen before a time [ns]."""
        return self.stamp < stamp


# fmt: off
@dataclass(frozen=True)
class TrackSource:
    """A topic with what another tracker or detector sees."""

    name: str
    topic: str = setting('tracks', '', 'Topic of this tracker.', live=False)
    type: Literal[
        'sensor_msgs/msg/PointCloud2',
        'vision_msgs/msg/Detection3DArray',
        'autoware_perception_msgs/msg/TrackedObjects',
        'radar_msgs/msg/RadarTracks',
        'costmap_converter_msgs/msg/ObstacleArrayMsg',
        'derived_object_msgs/msg/ObjectArray',
    ] = setting('sensor_msgs/msg/PointCloud2', '',
        'Messages of this tracker; the package of the type must be installed.', live=False)
    radius: float = setting(0.3, 'm', 'Radius of objects whose message has no extent.', POSITIVE,
        live=False)
    position_stddev: float = setting(0.1, 'm',
        'Standard deviation of positions whose message has none.', NOT_NEGATIVE, live=False)
# fmt: on
