"""Sensors, and the straight beams that they have measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Literal

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, Range, setting

Pose = tuple[float, float, float]

_MESSAGES: Final = {'scan': 'LaserScan', 'cloud': 'PointCloud2'}


class ScanError(ValueError):
    """Unusable message of a sensor."""

    def __init__(self, where: str, found: str, wanted: str) -> None:
        """Build the message from sensor and field, value found and value wanted."""
        super().__init__(f'{where}: found {found}, wanted {wanted}')


# fmt: off
@dataclass(frozen=True)
class Sensor:
    """A sensor on the robot."""

    name: str
    frame_id: str = setting('base_scan', '', 'Frame of its messages; others are refused.',
        live=False)
    pose: Pose = setting((0.0, 0.0, 0.0), 'm, m, rad',
        'Pose of this sensor on the robot (x, y, heading).', live=False)
    reach: float = setting(8.0, 'm',
        'Distance from this sensor beyond which its measurements are ignored.', POSITIVE,
        live=False)
    heights: tuple[float, float] = setting((-1e3, 1e3), 'm',
        'Least and greatest z of the points of a `cloud` that are obstacles, in its frame.',
        live=False)
    topic: str = setting('scan', '', 'Topic of this sensor.', live=False)
    type: Literal['scan', 'cloud'] = setting('scan', '',
        'Messages of this sensor: `scan` for LaserScan, `cloud` for PointCloud2.', live=False)
    # fmt: on

    @property
    def message_type(self) -> str:
        """Type of its messages, as ROS and bags write it."""
        return f'sensor_msgs/msg/{_MESSAGES[self.type]}'

    def topic_in(self, namespace: str) -> str:
        """Full name of its topic, for a node in a namespace."""
        return self.topic if self.topic.startswith('/') else f'{namespace}/{self.topic}'

    def check_frame(self, message: Any) -> None:
        """Raise `ScanError` for a message in another frame."""
        found = message.header.frame_id
        if found != self.frame_id:
            wanted = f'{self.frame_id!r} (sensors.{self.name}.frame_id)'
            raise ScanError(f'{self.name}: frame_id', repr(found), wanted)


# fmt: off
@dataclass(frozen=True)
class SightSettings:
    """Sensors, and the memory of their sightings."""

    sensors: tuple[Sensor, ...] = ()
    size: float = setting(10.0, 'm',
        'Side of the square grid around the robot in which obstacles are remembered.',
        Range(1.0, 100.0), live=False)
    resolution: float = setting(0.05, 'm', 'Side length of its cells.', Range(0.01, 1.0),
        live=False)
    memory: float = setting(10.0, 's', 'Time for which cells out of sight are remembered.',
        NOT_NEGATIVE, live=False)
    timeout: float = setting(0.5, 's',
        "Age of a sensor's last message at which the sensor counts as lost and the robot is "
        'stopped.', POSITIVE, live=False)
    moving: bool = setting(True, '',
        'Whether moving obstacles are tracked, and avoided at their predicted positions; otherwise '
        'they count as static where they were last seen.', live=False)
# fmt: on


@dataclass(frozen=True, eq=False)
class Sight:
    """Beams in the frame of the sensor."""

    sensor: Sensor
    stamp: int  # time of the last one [ns]
    stamps: IntArray  # time of each, ascending, shape ``(B,)`` [ns]
    begins: Array  # first point of each that shows free space, shape ``(B, 2)`` [m]
    ends: Array  # end of each, shape ``(B, 2)`` [m]
    hits: BoolArray  # whether it ended at an obstacle, shape ``(B,)``
    # Whether neighbours in the array are neighbours in space: then the space between two of them is
    # seen as well, and beams show that an obstacle is gone. The beams of a cloud have several
    # heights: one may pass above an obstacle that another one met.
    is_sweep: bool


@dataclass(frozen=True, eq=False)
class Beams:
    """Beams in the frame of odometry; attributes as of `Sight`."""

    stamp: int
    # Place of the sensor, on average while it measured, shape ``(2,)`` [m]. The beams of a cloud
    # may all start far from it, where they come to heights that count.
    origin: Array
    starts: Array
    ends: Array
    hits: BoolArray
    is_sweep: bool
