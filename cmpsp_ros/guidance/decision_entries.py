"""Entries of a decision: how each field is written as text by key, and read back."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple, get_args

import numpy as np

from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.messages.tracks import read_keys, track_keys

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
