"""Odometry as it arrives, its publishers, and watches over it and over ROS time."""

import struct
import time
from collections.abc import Callable

from rclpy.lifecycle import LifecycleNode

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import OdometryError, OdometryReading
from cmpsp_ros.nodes.common.topic import Listener, publisher_names, waiting
from cmpsp_ros.nodes.common.topics import GUIDANCE_ODOM

_HEADER = 4  # bytes of the encapsulation header; alignment counts from its end
# A stamp, the length of a string, a pose.
_LITTLE_ENDIAN, _BIG_ENDIAN = (
    (struct.Struct(f'{order}iI'), struct.Struct(f'{order}I'), struct.Struct(f'{order}7d'))
    for order in '<>'
)

_UNREADABLE = 'Odometry cannot be read: found {} bytes that are no nav_msgs/Odometry in CDR.'
_PATIENCE = 1.0  # time for which ROS time may stand still without a warning [s]


def read_odometry(data: bytes) -> OdometryReading:
    """Read a serialised `nav_msgs/Odometry` without covariance and twist, or raise OdometryError.

    rclpy takes as long for it as deciding does. The bytes are CDR (OMG DDS-RTPS 2.5, section
    10, with the alignment of XCDR version 1).
    """
    try:
        stamp, length, numbers = _LITTLE_ENDIAN if data[1] & 1 else _BIG_ENDIAN
        sec, nanosec = stamp.unpack_from(data, _HEADER)
        frame_id, at = _string(data, _HEADER + stamp.size, length)
        child_frame_id, at = _string(data, _align(at, length.size), length)
        x, y, _, *rotation = numbers.unpack_from(data, _align(at, 8))
    except (IndexError, struct.error, UnicodeDecodeError) as error:
        raise OdometryError(_UNREADABLE.format(len(data))) from error
    stamp_ns = sec * NANOSECONDS + nanosec
    qx, qy, qz, qw = rotation
    return OdometryReading(stamp_ns, frame_id, child_frame_id, (x, y), (qx, qy, qz, qw))


class OdometryInput(Listener):
    """Listens to odometry, given to `hear` as bytes."""

    def __init__(self, node: LifecycleNode, hear: Callable[[bytes], None]) -> None:
        super().__init__(node)
        self._subscription = GUIDANCE_ODOM.listen_on(node, hear, raw=True)
        self._subscriptions.append(self._subscription)

    def newest(
        self, data: bytes, now: int, oldest: float, is_due: Callable[[int], bool]
    ) -> tuple[OdometryReading, bytes]:
        """Odometry of a message, or of the newest waiting one if it is outdated, with its bytes.

        It is outdated where a decision `is_due` and it is older than `oldest` [s]. Raises
        OdometryError.
        """
        reading = read_odometry(data)
        if (now - reading.stamp) / NANOSECONDS <= oldest or not is_due(reading.stamp):
            return reading, data
        newest = [data, *waiting(self._subscription)][-1]
        return read_odometry(newest), newest

    @property
    def topic(self) -> str:
        """Full name of the topic."""
        return str(self._subscription.topic_name)

    @property
    def publishers(self) -> int:
        """Number of matched publishers."""
        return int(self._subscription.get_publisher_count())

    def warning(self) -> str:
        """Names of the publishers, in a sentence, if there are several, else ''."""
        if self.publishers < 2:
            return ''
        names = publisher_names(self._node, self.topic)
        return f'{len(names)} publishers on {self.topic}: {", ".join(names)}.'


class OdometryWatchdog:
    """Time since usable odometry came; there is no silence before the first."""

    def __init__(self) -> None:
        self._heard_at: int | None = None
        self._noticed_at: int | None = None

    def end(self, now: int) -> None:
        """Note the arrival of odometry at a time [ns]."""
        self._heard_at = now

    def age(self, now: int) -> float | None:
        """Time since the last one [s]; None before the first."""
        return None if self._heard_at is None else (now - self._heard_at) / NANOSECONDS

    def is_longer_than(self, timeout: float, now: int) -> bool:
        """True if nothing has arrived for longer than that [s]."""
        age = self.age(now)
        return age is not None and age > timeout

    def goes_on(self, timeout: float, now: int) -> bool:
        """True if the limit was exceeded at the previous check, too: a clock may jump."""
        if not self.is_longer_than(timeout, now):
            self._noticed_at = None
        elif self._noticed_at is None:
            self._noticed_at = now
        else:
            return now > self._noticed_at
        return False


class ClockWatch:
    """Detects ROS time that stands still: a paused simulation, or a dead `/clock`."""

    def __init__(self) -> None:
        self._now: int | None = None
        self._since = 0.0

    def warnings(self, now: int) -> list[str]:
        """Warnings in sentences; to be asked a few times a second, with ROS time [ns]."""
        seen_at = time.monotonic()
        if now != self._now:
            self._now, self._since = now, seen_at
        if seen_at - self._since <= _PATIENCE:
            return []
        return [f'The clock stands still at {now / 1e9:.3f} s: is /clock still published?']


def _string(data: bytes, at: int, length: struct.Struct) -> tuple[str, int]:
    """A string and where it ends; its length counts the zero byte behind it."""
    (size,) = length.unpack_from(data, at)
    begin, end = at + length.size, at + length.size + size
    # Python would silently truncate a string that ends beyond the data.
    if size == 0 or data[end - 1]:
        raise IndexError
    return data[begin : end - 1].decode(), end


def _align(at: int, size: int) -> int:
    return _HEADER + -(-(at - _HEADER) // size) * size
