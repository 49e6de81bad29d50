"""Decision of a control step: each field declared once, written as text by key and read back."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from enum import Enum, IntEnum
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Final, NamedTuple, get_args, get_type_hints

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.messages.tracks import MovingObject, read_keys, track_keys
from cmpsp_ros.guidance.times import Horizon

if TYPE_CHECKING:
    from cmpsp_ros.robots import Robot


Parse = Callable[[str], Any]


class Key(NamedTuple):
    """One key: conversion of its text to a value, and unit."""

    parse: Parse
    unit: str = ''


@dataclass(frozen=True)
class Entry:
    """Declaration of a field of a decision."""

    meaning: str  # in a sentence
    unit: str = ''  # empty where there is none
    key: str = ''  # empty where it is the name of the field
    seldom: bool = False  # left out where the field has its default; other keys are required
    is_input: bool = False  # received, not decided: a replay follows it and does not compare it
    parse: Parse = str  # conversion of its text; by default that of the field's type
    default: Any = None  # of the field; None where it has none

    def of_field(self, name: str, kind: Any, default: Any) -> Entry:
        """The same for a field of this name, type and default."""
        kinds = [each for each in get_args(kind) if each is not type(None)]
        kind = kinds[0] if type(None) in get_args(kind) else kind
        parse = self.parse
        if kind in _PARSE:
            parse = _PARSE[kind]
        elif get_args(kind)[:1] == (float,):
            parse = _pose
        return replace(self, key=self.key or name, parse=parse, default=default)

    @property
    def keys(self) -> Mapping[str, Key]:
        """The keys that it may be written under."""
        return {self.key: Key(self.parse, self.unit)}

    def write(self, value: Any) -> Mapping[str, object]:
        """Values of the field by key."""
        return {self.key: value}

    def read(self, found: Mapping[str, Any]) -> Any:
        """Value of the field; raises KeyError for a required key that is missing."""
        return found[self.key]


class IntervalEntry(Entry):
    """Estimate with its least and largest possible value."""

    @property
    def keys(self) -> Mapping[str, Key]:  # noqa: D102
        return {f'{self.key}{end}': Key(float, self.unit) for end in ('', '_min', '_max')}

    def write(self, value: Any) -> Mapping[str, object]:  # noqa: D102
        return dict(zip(self.keys, value, strict=True))

    def read(self, found: Mapping[str, Any]) -> Any:  # noqa: D102
        return tuple(found[key] for key in self.keys)


class WheelSpeedsEntry(Entry):
    """Speeds of right and left wheel under a key each, or those of more wheels in one text."""

    @property
    def keys(self) -> Mapping[str, Key]:  # noqa: D102
        all_wheels = {self.key: Key(_numbers, self.unit)}
        return dict.fromkeys(_TWO_WHEELS, Key(float, self.unit)) | all_wheels

    def write(self, value: Any) -> Mapping[str, object]:  # noqa: D102
        speeds = value.tolist()
        if len(speeds) == len(_TWO_WHEELS):
            return dict(zip(_TWO_WHEELS, speeds, strict=True))
        return {self.key: tuple(speeds)}

    def read(self, found: Mapping[str, Any]) -> Any:  # noqa: D102
        if self.key in found:
            return np.array(found[self.key])
        return np.array([found[key] for key in _TWO_WHEELS])


class GoalEntry(Entry):
    """Goal, where it has a name: one that was received, or one of several."""

    @property
    def keys(self) -> Mapping[str, Key]:  # noqa: D102
        units = {'x': 'm', 'y': 'm', 'time': 's', 'heading': 'rad'}
        parts = {f'{self.key}_{part}': Key(float, unit) for part, unit in units.items()}
        return {self.key: Key(str), **parts}

    def write(self, value: Any) -> Mapping[str, object]:  # noqa: D102
        numbers = *value.position, value.time, value.heading
        parts = zip(self.keys, (value.name, *numbers), strict=True)
        return {key: part for key, part in parts if part is not None} if value.name else {}

    def read(self, found: Mapping[str, Any]) -> Any:  # noqa: D102
        name, x, y, time, heading = self.keys
        return Goal((found[x], found[y]), found[time], found.get(heading), found[name])


class TracksEntry(Entry):
    """Moving obstacles and plans of other robots, by number or namespace and time stamp."""

    def write(self, value: Any) -> Mapping[str, object]:  # noqa: D102
        return {self.key: track_keys(value)}

    def read(self, found: Mapping[str, Any]) -> Any:  # noqa: D102
        return read_keys(found[self.key])


class PhasesEntry(Entry):
    """Computing times, under the name of each phase and ``_ms``."""

    @property
    def keys(self) -> Mapping[str, Key]:  # noqa: D102
        return {}

    def write(self, value: Any) -> Mapping[str, object]:  # noqa: D102
        return {f'{phase}_ms': time for phase, time in value.items()}


def exact_repr(value: object) -> str:
    """Text that reads back bit for bit: `true`, `false`, numbers with spaces between them."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, Enum):
        return value.name.lower()
    if isinstance(value, tuple):
        return ' '.join(map(repr, value))
    return repr(float(value)) if isinstance(value, float) else str(value)


def truth(text: str) -> bool:
    """Value of `true` or `false`; raises ValueError for anything else."""
    if text not in {'true', 'false'}:
        raise ValueError(f'found {text!r}, wanted true or false')
    return text == 'true'


def _numbers(text: str) -> tuple[float, ...]:
    return tuple(map(float, text.split(' ')))


def _pose(text: str) -> tuple[float, ...]:
    x, y, heading = _numbers(text)
    return x, y, heading


_PARSE: Mapping[Any, Parse] = {int: int, float: float, bool: truth}
_TWO_WHEELS = 'wheel_speed_right', 'wheel_speed_left'


UNTIMED: Final[Mapping[str, float]] = MappingProxyType({})
Interval = tuple[float, float, float]


class FallbackLevel(IntEnum):
    """Origin of the command, best first; the previous plan is the last audited one, shifted."""

    NOMINAL = 0
    ELASTIC = 1
    PREVIOUS_PLAN = 2
    STOP = 3


class Plan(NamedTuple):
    """Controls over the horizon and the path they lead along."""

    horizon: Horizon  # when each control is given
    controls: Array  # shape ``(N + 1, r)``
    poses: Array  # predicted, shape ``(N + 1, 3)`` [m, m, rad]; the first is that after the delay
    delay: int = 0  # time after which a control that is given takes effect [ns]

    def stamps(self, begin: int) -> list[int]:
        """Time of each pose [ns], of a plan whose first control is given at `begin` [ns]."""
        edges = self.horizon.edges
        stamps: list[int] = (edges + (begin + self.delay - int(edges[0]))).tolist()
        return stamps

    def pose_at(self, begin: int, stamp: int) -> list[float]:
        """Pose (x, y, heading) at `stamp` [ns], interpolated linearly [m, m, rad]."""
        since = [each - stamp for each in self.stamps(begin)]
        return [float(np.interp(0.0, since, each)) for each in self.poses.T]


class Decision(NamedTuple):
    """Outcome of one control step; each field is declared with its entry in messages and bags."""

    # fmt: off
    step: Annotated[int, Entry('Number of the control step, from 0')]
    stamp: Annotated[int, Entry('Time stamp of the odometry that it answers', 'ns')]
    level: Annotated[FallbackLevel, Entry('Fallback level', key='fallback_level')]
    reason: Annotated[str, 'Reason for that level, in a sentence']
    time_left: Annotated[float, Entry(
        'Time to the final time; 0 once it has passed, infinite without one', 's')]
    wheel_speeds: Annotated[Array, WheelSpeedsEntry(
        'Commanded speed of each wheel (W,), right and left first', 'rad/s')]
    steering_angle: Annotated[float | None, Entry('Of a car', 'rad', seldom=True)]
    twist: Annotated[Array, 'The same as the twist of a `Robot`, shape (2,) or (3,)']
    plan: Annotated[Plan | None, 'The plan followed; None when stopped']
    terminal_error: Annotated[float, Entry(
        "Distance of the plan's end, or of a stopped robot, from the goal, which is a line"
        ' across the road where a road is followed', 'm')]
    clearance: Annotated[float, Entry(
        'Least clearance from obstacles and road edges, less the robot, until the end of the'
        ' coming control period', 'm')]
    worst_clearance: Annotated[float, Entry('The same along the whole plan', 'm')]
    slack: Annotated[float, Entry('Largest violation of a linearised constraint', 'm')] = 0.0
    iterations: Annotated[int, Entry('C-MPSP iterations')] = 0
    qp_iterations: Annotated[int, Entry('Iterations of the QP solver in the last of them')] = 0
    active_rows: Annotated[int, Entry('Constraints active in the last of them')] = 0
    failures: Annotated[int, Entry('Failed control steps in a row, this one included')] = 0
    wheel_slip: Annotated[float, Entry('Estimated wheel-slip ratio', seldom=True)] = 0.0
    wheel_lag: Annotated[Interval | None, IntervalEntry(
        'Estimated lag of the wheels', 's', seldom=True)] = None
    response_delay: Annotated[Interval | None, IntervalEntry(
        'Delay and lag of the response to commands; None while odometry agrees with'
        ' `command_delay`', 's', seldom=True)] = None
    prediction_error: Annotated[float, Entry(
        'Bound of the distance of odometry from its prediction', 'm', seldom=True)] = 0.0
    finished: Annotated[bool, Entry('The final time has passed')] = False
    missed: Annotated[bool, Entry('It passed with the robot beyond the tolerance')] = False
    halted: Annotated[bool, Entry('Stop without odometry, by the node', is_input=True)] = False
    cancelled: Annotated[bool, Entry(
        'The goal was cancelled, or none has come yet', seldom=True)] = False
    braking: Annotated[bool, Entry(
        'It brakes along the audited path, by the node', seldom=True)] = False
    late: Annotated[float, Entry(
        'Computing time of one that came too late', 's', seldom=True, is_input=True)] = 0.0
    skipped: Annotated[bool, Entry(
        'Older odometry was passed over', seldom=True, is_input=True)] = False
    pose: Annotated[tuple[float, ...] | None, Entry(
        'Pose [m, m, rad] after a transform, or chosen among several publishers',
        seldom=True, is_input=True)] = None
    run: Annotated[int, Entry('Resets of the law before it', is_input=True)] = 0
    revision: Annotated[int, Entry('Changes of the settings before it', is_input=True)] = 0
    tracks: Annotated[tuple[MovingObject, ...], TracksEntry(
        'Moving obstacles and plans of others known then', key='moving_obstacles',
        seldom=True, is_input=True)] = ()
    sighting: Annotated[int | None, Entry(
        'Time stamp of the grid that sensors had shown', 'ns', seldom=True)] = None
    goal: Annotated[Goal | None, GoalEntry(
        'Goal; None where a road is followed', seldom=True)] = None
    heading_error: Annotated[float | None, Entry(
        "Of the plan's end, where the goal has a heading", 'rad', seldom=True)] = None
    goals_received: Annotated[int, Entry('Goals since the run began', seldom=True)] = 0
    phases: Annotated[Mapping[str, float], PhasesEntry('Computing time by phase', 'ms')] = UNTIMED
    # fmt: on


def _fields() -> Iterator[tuple[str, Entry]]:
    for name, hint in get_type_hints(Decision, include_extras=True).items():
        kind, entry = get_args(hint)
        if isinstance(entry, Entry):
            default = Decision._field_defaults.get(name)
            yield name, entry.of_field(name, kind, default)


FIELDS: Final[Mapping[str, Entry]] = MappingProxyType(dict(_fields()))
"""Entries by the names of their fields, in the order in which they are written."""

DECISION_KEYS: Final[Mapping[str, Key]] = MappingProxyType(
    {key: found for entry in FIELDS.values() for key, found in entry.keys.items()}
)
"""All keys but those of computing times, which end in ``_ms``."""

_WRITTEN: Final = tuple((Decision._fields.index(name), entry) for name, entry in FIELDS.items())


def decision_to_key_values(decision: Decision) -> dict[str, str]:
    """Text by key of all but reason, twist and plan; floats read back bit for bit."""
    return {
        key: exact_repr(value)
        for index, entry in _WRITTEN
        if not entry.seldom or decision[index] != entry.default
        for key, value in entry.write(decision[index]).items()
    }


def is_at_rest(values: Mapping[str, str], robot: Robot) -> bool:
    """True if the key values are of a decision that stops the robot."""
    keys = *FIELDS['wheel_speeds'].keys, 'steering_angle'
    wheels = ' '.join(values[key] for key in keys if key in values).split()
    return not robot.twist_of_wheels(np.array(wheels, dtype=float)).any()


def response_ms(step_ms: float, odometry_to_command_ms: float, command_delay: float) -> float:
    """Computing time, or time from odometry to command beyond `command_delay`, if longer [ms]."""
    return max(step_ms, odometry_to_command_ms - 1e3 * command_delay)


def severity(decision: Decision) -> int:
    """0 where all is well, 1 for a warning such as a missed goal, 2 for an error."""
    if decision.finished or decision.cancelled:
        return int(decision.missed)
    if decision.level == FallbackLevel.NOMINAL:
        return int(decision.late > 0.0)
    return 2 if decision.level == FallbackLevel.STOP else 1


def waypoints(plan: Plan) -> list[tuple[float, float, float, float]]:
    """Poses of a plan: ``x`` and ``y`` [m], then ``z`` and ``w`` of the quaternion."""
    return [
        (x, y, math.sin(heading / 2.0), math.cos(heading / 2.0))
        for x, y, heading in plan.poses.tolist()
    ]
