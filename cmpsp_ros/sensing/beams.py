"""What a sensor has seen at an instant: straight beams from it to what they met."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, Range, setting

Indices = IntArray
Pose = tuple[float, float, float]

_NS = 1_000_000_000


class ScanError(ValueError):
    """A message of a sensor that is unusable.

    Attributes:
        where: The sensor, and the field of its message.
        found: What is there.
        wanted: What would be right.
    """

    def __init__(self, where: str, found: str, wanted: str) -> None:
        """Say what is wrong, and what would be right."""
        super().__init__(f'{where}: found {found}, wanted {wanted}')
        self.where, self.found, self.wanted = where, found, wanted


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

    def check_frame(self, message: Any) -> None:
        """Refuse a message in another frame.

        Raises:
            ScanError: It is in another one.
        """
        found = message.header.frame_id
        if found != self.frame_id:
            wanted = f'{self.frame_id!r} (sensors.{self.name}.frame_id)'
            raise ScanError(f'{self.name}: frame_id', repr(found), wanted)


# fmt: off
@dataclass(frozen=True)
class SightSettings:
    """Sensors, and the memory of what they have seen."""

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
# fmt: on


@dataclass(frozen=True, eq=False)
class Sight:
    """Beams in the sensor's own frame, before it is known where the sensor was.

    Attributes:
        sensor: Where they come from.
        stamp: When the last was measured [ns].
        stamps: When each was measured, in ascending order, shape ``(B,)`` [ns].
        begins: Where the part of each begins that shows free space, shape ``(B, 2)`` [m].
        ends: Where each ends, shape ``(B, 2)`` [m].
        hits: Whether there is something at its end, shape ``(B,)``.
        is_sweep: Whether neighbours in the array are neighbours in space, so that what is between
            two of them is seen as well, and whether beams see what is gone. A cloud of points has
            beams at different heights: one may pass above what another one has met.
    """

    sensor: Sensor
    stamp: int
    stamps: Indices
    begins: Array
    ends: Array
    hits: BoolArray
    is_sweep: bool


@dataclass(frozen=True, eq=False)
class Beams:
    """Beams in the frame of odometry.

    Attributes:
        stamp: When the last was measured [ns].
        starts: Where each begins to show free space, shape ``(B, 2)`` [m].
        ends: As of `Sight`, shape ``(B, 2)`` [m].
        hits: As of `Sight`, shape ``(B,)``.
        is_sweep: As of `Sight`.
    """

    stamp: int
    starts: Array
    ends: Array
    hits: BoolArray
    is_sweep: bool


def project(sight: Sight, poses: Array) -> Beams:
    """Beams from where the sensor was when each was measured.

    Args:
        sight: The beams.
        poses: Of the robot at their stamps, shape ``(B, 3)`` [m, m, rad].
    """
    ahead, left, turned = sight.sensor.pose
    places = poses[:, :2] + _turned(np.array([ahead, left]), poses[:, 2])
    starts, ends = (
        places + _turned(each, poses[:, 2] + turned) for each in (sight.begins, sight.ends)
    )
    return Beams(sight.stamp, starts, ends, sight.hits, sight.is_sweep)


def stamp_of(message: Any) -> int:
    """Time stamp of a message with a header [ns]."""
    return int(message.header.stamp.sec) * _NS + int(message.header.stamp.nanosec)


def _turned(points: Array, angles: Array) -> Array:
    cosine, sine, x, y = np.cos(angles), np.sin(angles), points[..., 0], points[..., 1]
    return np.column_stack([cosine * x - sine * y, sine * x + cosine * y])
