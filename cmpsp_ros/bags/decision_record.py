"""One recorded decision: the only list of the entries of a `~/decision` message.

Replay, audit, export, report and the live page all read decisions by this list. The keys are a
contract with bags, layouts and other programs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar, overload

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance import MOVING, WHEELS, Goal, present_keys, response_ms
from cmpsp_ros.guidance.messages import read_keys

Waypoint = tuple[float, float, float, float]
T = TypeVar('T')

_LATEST = 1 << 62
"""In the year 2116 [ns]; what is later fits no array of stamps."""

_MISSING: Final = object()


class Entry(Generic[T]):
    """One entry of a decision's message, parsed when it is read.

    Args:
        parse: Converts its text to a value.
        unit: Unit, empty where there is none.
        key: Its key in the message, if that is not its name.
        default: Value if the message has no such key; every decision has it when absent.
    """

    name: str

    def __init__(
        self, parse: Callable[[str], T], unit: str = '', *, key: str = '', default: Any = _MISSING
    ) -> None:
        self.parse, self.unit, self.key, self._default = parse, unit, key, default

    def __set_name__(self, _owner: type, name: str) -> None:
        self.name, self.key = name, self.key or name

    @overload
    def __get__(self, record: None, _owner: type) -> Entry[T]: ...
    @overload
    def __get__(self, record: DecisionRecord, _owner: type) -> T: ...
    def __get__(self, record: DecisionRecord | None, _owner: type) -> Entry[T] | T:
        if record is None:
            return self
        text = record.entries.get(self.key)
        if text is None:
            if self._default is not _MISSING:
                value: T = self._default
                return value
            raise BagError(
                f'{record.source}: found a decision without {self.key}, wanted one of this package'
            )
        try:
            return self.parse(text)
        except ValueError:
            wanted = 'true or false' if self.parse is truth else 'a number'
            raise BagError(
                f'{record.source}: found {self.key} {text[:40]!r} in a decision, wanted {wanted}'
            ) from None


def truth(text: str) -> bool:
    """Whether text is `true`.

    Raises:
        ValueError: It is not `false` either.
    """
    if text not in {'true', 'false'}:
        raise ValueError(f'found {text!r}, wanted true or false')
    return text == 'true'


def triple(text: str) -> tuple[float, float, float]:
    """Three numbers with spaces between them.

    Raises:
        ValueError: It is something else.
    """
    x, y, heading = numbers(text)
    return x, y, heading


def numbers(text: str) -> tuple[float, ...]:
    """Numbers with spaces between them.

    Raises:
        ValueError: It is something else.
    """
    return tuple(map(float, text.split(' ')))


def status_of(message: Any) -> Any:
    """The status in a message of `~/decision`: an array of one; of earlier versions, itself.

    Raises:
        LookupError: The array is empty.
    """
    return message.status[0] if hasattr(message, 'status') else message


def entries_of(status: Any) -> dict[str, str]:
    """Key values of a status, as this version names them."""
    return present_keys((str(each.key), str(each.value)) for each in status.values)


@dataclass(frozen=True)
class DecisionRecord:
    """One decision, with everything that was published on it.

    The entries are explained in `cmpsp_ros.guidance.decision.Decision`.

    Attributes:
        source: Bag and topic, for errors.
        received: Time of reception [ns].
        reason: Its reason, in words.
        entries: All other entries of its message, as text by key.
        command: Forward, to the left and turning on the command's topic [m/s, m/s, rad/s]; None
            where not recorded.
        path: The predicted path; None where not recorded.
    """

    source: str
    received: int
    reason: str
    entries: Mapping[str, str]
    command: tuple[float, float, float] | None = None
    path: tuple[Waypoint, ...] | None = None

    step = Entry(int)
    stamp = Entry(int, 'ns')
    level = Entry(str, key='fallback_level')
    time_left = Entry(float, 's')
    wheel_speed_right = Entry(float, 'rad/s')
    wheel_speed_left = Entry(float, 'rad/s')
    steering_angle = Entry[float | None](float, 'rad', default=None)
    _all_wheels = Entry[tuple[float, ...] | None](numbers, 'rad/s', key=WHEELS, default=None)
    terminal_error = Entry(float, 'm')
    clearance = Entry(float, 'm')
    worst_clearance = Entry(float, 'm')
    slack = Entry(float, 'm')
    iterations = Entry(int)
    qp_iterations = Entry(int)
    active_rows = Entry(int)
    failures = Entry(int)
    wheel_slip = Entry(float, default=0.0)
    wheel_lag = Entry(float, 's', default=0.0)
    wheel_lag_min = Entry(float, 's', default=0.0)
    wheel_lag_max = Entry(float, 's', default=0.0)
    response_delay = Entry[float | None](float, 's', default=None)
    response_delay_min = Entry[float | None](float, 's', default=None)
    response_delay_max = Entry[float | None](float, 's', default=None)
    prediction_error = Entry(float, 'm', default=0.0)
    finished = Entry(truth)
    missed = Entry(truth, default=False)
    _halted = Entry(truth, key='halted', default=None)
    cancelled = Entry(truth, default=False)
    braking = Entry(truth, default=False)
    late = Entry(float, 's', default=0.0)
    skipped = Entry(truth, default=False)
    pose = Entry[tuple[float, float, float] | None](triple, default=None)
    run = Entry[int | None](int, default=None)
    revision = Entry[int | None](int, default=None)
    tracks_known = Entry(str, key=MOVING, default='')
    sighting = Entry[int | None](int, 'ns', default=None)
    goal_name = Entry[str | None](str, key='goal', default=None)
    goal_x = Entry(float, 'm')
    goal_y = Entry(float, 'm')
    goal_time = Entry(float, 's')
    goal_heading = Entry[float | None](float, 'rad', default=None)
    heading_error = Entry[float | None](float, 'rad', default=None)
    goals_received = Entry(int, default=0)
    step_ms = Entry[float | None](float, 'ms', default=None)
    odometry_to_command_ms = Entry[float | None](float, 'ms', default=None)

    @classmethod
    def of(cls, source: str, received: int, message: Any) -> DecisionRecord:
        """A message of `~/decision`, without what else was published.

        Raises:
            BagError: It is none.
        """
        try:
            status = status_of(message)
            return cls(source, received, str(status.message), entries_of(status))
        except (AttributeError, TypeError, LookupError) as error:
            raise BagError(
                f'{source}: found a message that is none of its type, wanted a decision'
            ) from error

    @property
    def halted(self) -> bool:
        """Whether it answers no odometry. Recordings that do not say so show it otherwise."""
        known: bool | None = self._halted
        if known is None:
            return self.level == 'stop' and self.entries.get('terminal_error') == 'nan'
        return known

    @property
    def arrived(self) -> bool:
        """True once the final time has passed and odometry showed the robot at its goal then."""
        return self.finished and not (self.missed or self.halted)

    @property
    def wheel_speeds(self) -> Array:
        """Of right and left wheel, or of all there are and the steering [rad], ``(W,)`` [rad/s]."""
        if self._all_wheels is not None:
            steering = () if self.steering_angle is None else (self.steering_angle,)
            return np.array([*self._all_wheels, *steering])
        return np.array([self.wheel_speed_right, self.wheel_speed_left])

    @property
    def goal(self) -> Goal | None:
        """The goal of the decision, if it has one."""
        if self.goal_name is None:
            return None
        position = self.goal_x, self.goal_y
        return Goal(position, self.goal_time, self.goal_heading, self.goal_name)

    def response_ms(self, command_delay: float) -> float:
        """Response time, as in `cmpsp_ros.guidance.key_values.response_ms` [ms]."""
        answered = self.odometry_to_command_ms or 0.0
        return response_ms(self.step_ms or 0.0, answered, command_delay)

    def misses_deadline(self, period: float, command_delay: float) -> bool:
        """True if its command was sent too late, or not at all for that reason.

        Args:
            period: Control period [s].
            command_delay: As in the parameters [s].
        """
        return self.late > 0.0 or self.response_ms(command_delay) > 1e3 * period

    @property
    def tracks(self) -> list[tuple[int | str, int]]:
        """Numbers (of other robots: namespaces) and stamps of moving obstacles, as known."""
        try:
            return read_keys(self.tracks_known)
        except ValueError as error:
            raise BagError(f'{self.source}: {error}') from None


ENTRIES: Final[Mapping[str, Entry[Any]]] = {
    each.key: each for each in vars(DecisionRecord).values() if isinstance(each, Entry)
}
"""All entries by their keys, in the order in which they are written."""


def read_decisions(bag: Bag, topic: str) -> tuple[DecisionRecord, ...]:
    """Decisions of a topic, in order; none where the bag lacks the topic.

    Raises:
        BagError: A message is no decision of this package.
    """
    return tuple(_read(bag, topic)) if topic in bag.topics else ()


def wheel_speeds(decisions: Iterable[DecisionRecord]) -> Array:
    """Of each, shape ``(D, W)`` [rad/s]."""
    speeds = [each.wheel_speeds for each in decisions]
    return np.array(speeds) if speeds else np.empty((0, 2))


def _read(bag: Bag, topic: str) -> Iterator[DecisionRecord]:
    source = f'{bag.path}: {topic}'
    for received, message in bag.messages(topic):
        record = DecisionRecord.of(source, received, message)
        if not 0 <= record.stamp <= _LATEST:
            raise BagError(f'{source}: found a stamp of {record.stamp} ns, wanted one of a clock')
        # Whatever will be asked of it is asked now, so that errors are those of reading.
        for name in _CHECKED:
            getattr(record, name)
        yield record


_CHECKED: Final = (
    *('step', 'run', 'revision', 'level', 'finished', 'missed', 'halted'),
    *('cancelled', 'braking', 'late', 'skipped', 'pose'),
    *('wheel_speeds', 'step_ms', 'odometry_to_command_ms', 'goal', 'goals_received'),
)
