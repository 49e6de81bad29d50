"""Decisions in bags: the fields of `Decision`, read from a `~/decision` message and written."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance import (
    FIELDS,
    NANOSECONDS,
    Decision,
    Key,
    Plan,
    decision_to_key_values,
    response_ms,
    severity,
    truth,
    waypoints,
)
from cmpsp_ros.guidance.messages import Track

Waypoint = tuple[float, float, float, float]

_LATEST = 1 << 62  # in the year 2116 [ns]; later times fit no array of stamps


def status_of(message: Any) -> Any:
    """The status in a message of `~/decision`; raises `LookupError` for an empty array."""
    return message.status[0] if hasattr(message, 'status') else message


@dataclass(frozen=True)
class DecisionRecord:
    """One decision, with everything that was published on it.

    It has the fields of `cmpsp_ros.guidance.Decision` too, read from its entries when asked for;
    a level is its name, tracks are their numbers (of other robots: namespaces) and stamps.
    """

    source: str  # bag and topic, for errors
    received: int  # time of reception [ns]
    reason: str  # in words
    entries: Mapping[str, str]  # all other entries of its message, as text by key
    # Forward, to the left and turning on the command's topic [m/s, m/s, rad/s]; None where not
    # recorded.
    command: tuple[float, float, float] | None = None
    path: tuple[Waypoint, ...] | None = None  # the predicted path; None where not recorded

    @classmethod
    def of(cls, source: str, received: int, message: Any) -> DecisionRecord:
        """A message of `~/decision`, without command and path."""
        try:
            status = status_of(message)
            entries = {str(each.key): str(each.value) for each in status.values}
            return cls(source, received, str(status.message), entries)
        except (AttributeError, TypeError, LookupError) as error:
            raise BagError(
                f'{source}: found a message that is none of its type, wanted a decision'
            ) from error

    @property
    def why_given_up(self) -> str:
        """Reason with which the run ended before the goal, out of reach; '' if it did not."""
        return self.reason if self.finished and 'unreachable' in self.reason else ''

    def __getattr__(self, name: str) -> Any:
        """A field of `Decision`; raises `BagError` for a missing key or invalid text."""
        if name not in FIELDS:
            raise AttributeError(name)
        return self._read(name)

    def _read(self, name: str) -> Any:
        entry = FIELDS[name]
        keys = entry.keys.items()
        found = {key: self._parsed(key, each) for key, each in keys if key in self.entries}
        if entry.seldom and not found:
            return entry.default
        try:
            return entry.read(found)
        except KeyError as error:
            raise BagError(
                f'{self.source}: found a decision without {error.args[0]}, wanted one of this'
                ' package'
            ) from None
        except ValueError as error:
            raise BagError(f'{self.source}: {error}') from None

    def _parsed(self, name: str, key: Key) -> Any:
        text = self.entries[name]
        try:
            return key.parse(text)
        except ValueError:
            wanted = 'true or false' if key.parse is truth else 'a number'
            raise BagError(
                f'{self.source}: found {name} {text[:40]!r} in a decision, wanted {wanted}'
            ) from None

    @property
    def wheel_speeds(self) -> Array:
        """Right and left wheel, or all wheels and the steering angle [rad], ``(W,)`` [rad/s]."""
        speeds, steering = self._read('wheel_speeds'), self._read('steering_angle')
        return np.array([*speeds, *(() if steering is None else (steering,))])

    @property
    def arrived(self) -> bool:
        """True once the final time has passed and odometry showed the robot at its goal then."""
        return self.finished and not (self.missed or self.halted)

    @property
    def step_ms(self) -> float | None:
        """Computing time of the step [ms]; None if not measured."""
        return self._time('step_ms')

    def response_ms(self, command_delay: float) -> float:
        """Response time, as in `cmpsp_ros.guidance.response_ms` [ms]."""
        answered = self._time('odometry_to_command_ms') or 0.0
        return response_ms(self.step_ms or 0.0, answered, command_delay)

    def misses_deadline(self, period: float, command_delay: float) -> bool:
        """True if its command was sent too late, or not at all for that reason; times in [s]."""
        return self.late > 0.0 or self.response_ms(command_delay) > 1e3 * period

    def _time(self, key: str) -> float | None:
        return self._parsed(key, Key(float)) if key in self.entries else None


def read_decisions(bag: Bag, topic: str) -> tuple[DecisionRecord, ...]:
    """Decisions of a topic, in order; none if the bag lacks the topic."""
    return tuple(_read(bag, topic)) if topic in bag.topics else ()


def wheel_speeds(decisions: Iterable[DecisionRecord]) -> Array:
    """Wheel speeds of each decision, shape ``(D, W)`` [rad/s]."""
    speeds = [each.wheel_speeds for each in decisions]
    return np.array(speeds) if speeds else np.empty((0, 2))


def _read(bag: Bag, topic: str) -> Iterator[DecisionRecord]:
    source = f'{bag.path}: {topic}'
    for received, message in bag.messages(topic):
        record = DecisionRecord.of(source, received, message)
        if not 0 <= record.stamp <= _LATEST:
            raise BagError(f'{source}: found a stamp of {record.stamp} ns, wanted one of a clock')
        # All that will be asked of it, so that errors are those of reading.
        for name in _CHECKED:
            getattr(record, name)
        record.response_ms(0.0)
        yield record


_CHECKED: Final = (
    *('step', 'run', 'revision', 'level', 'finished', 'missed', 'halted'),
    *('cancelled', 'braking', 'late', 'skipped', 'pose', 'wheel_speeds', 'goal', 'goals_received'),
)


DECISION = 'diagnostic_msgs/msg/DiagnosticArray'
TWIST = 'geometry_msgs/msg/Twist'
PATH = 'nav_msgs/msg/Path'
CLOUD = 'sensor_msgs/msg/PointCloud2'

_FIELD = 'sensor_msgs/msg/PointField'
_LATEST_STAMP = (2**31 - 1) * NANOSECONDS


def decision_message(decision: Decision, name: str) -> bytes:
    """Everything about a decision but its plan, serialised as a `DECISION`."""
    pairs = [
        _make('diagnostic_msgs/msg/KeyValue', *item)
        for item in decision_to_key_values(decision).items()
    ]
    status = _make(
        'diagnostic_msgs/msg/DiagnosticStatus', severity(decision), name, decision.reason, '', pairs
    )
    # A stamp that no header can hold is in the entries alone.
    stamp = min(decision.stamp, _LATEST_STAMP)
    return _raw(_make(DECISION, _header('', stamp), [status]), DECISION)


def command_message(decision: Decision) -> bytes:
    """The command of a decision, serialised as a `TWIST`."""
    forward, *across, rate = decision.twist.tolist()
    left = across[0] if across else 0.0
    vector = jazzy().types['geometry_msgs/msg/Vector3']
    return _raw(_make(TWIST, vector(forward, left, 0.0), vector(0.0, 0.0, rate)), TWIST)


def path_message(plan: Plan, frame_id: str, stamp: int) -> bytes:
    """A plan that was made at a time [ns], serialised as a `PATH`."""
    poses = [
        _make(
            'geometry_msgs/msg/PoseStamped',
            _header(frame_id, when),
            _make(
                'geometry_msgs/msg/Pose',
                _make('geometry_msgs/msg/Point', x, y, 0.0),
                _make('geometry_msgs/msg/Quaternion', 0.0, 0.0, z, w),
            ),
        )
        for (x, y, z, w), when in zip(waypoints(plan), plan.stamps(stamp), strict=True)
    ]
    return _raw(_make(PATH, _header(frame_id, stamp), poses), PATH)


def tracks_message(tracks: Sequence[Track], frame_id: str, stamp: int) -> bytes:
    """Tracks at a time [ns], serialised as a `CLOUD`."""
    names = (*Track.FIELDS, *Track.DOUBTS)
    double, whole = 8, 6
    fields = [_make(_FIELD, name, 8 * k, double, 1) for k, name in enumerate((*names, 'z'))]
    point = struct.Struct(f'<{len(fields)}dI')
    fields.append(_make(_FIELD, 'id', point.size - 4, whole, 1))
    data = b''.join(
        point.pack(*(getattr(each, name) for name in names), 0.0, each.id) for each in tracks
    )
    row, raw = point.size * len(tracks), np.frombuffer(data, np.uint8)
    layout = 1, len(tracks), fields, False, point.size, row, raw, True
    return _raw(_make(CLOUD, _header(frame_id, stamp), *layout), CLOUD)


def _header(frame_id: str, stamp: int) -> Any:
    time = _make('builtin_interfaces/msg/Time', *divmod(stamp, NANOSECONDS))
    return _make('std_msgs/msg/Header', time, frame_id)


def _make(name: str, *fields: Any) -> Any:
    return jazzy().types[name](*fields)


def _raw(message: Any, name: str) -> bytes:
    return bytes(jazzy().serialize_cdr(message, name))
