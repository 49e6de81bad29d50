"""Parameters in force at each moment of a recording."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass
from typing import Any

from cmpsp_ros.bags.audit.sources import Places, Sources
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.inputs import recorded_values
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.errors import ParameterError
from cmpsp_ros.parameters.presets import load_parameter_file
from cmpsp_ros.parameters.settings import guidance_settings
from cmpsp_ros.parameters.table import Values, is_of_ros

_EVENTS = '/parameter_events'

# Fields of rcl_interfaces/msg/ParameterValue by its `type`, from 1.
_FIELDS = (
    'bool_value',
    'integer_value',
    'double_value',
    'string_value',
    'byte_array_value',
    'bool_array_value',
    'integer_array_value',
    'double_array_value',
    'string_array_value',
)


@dataclass(frozen=True)
class Epoch:
    """A stretch of time without a change of parameters.

    Attributes:
        since: Its beginning [ns].
        values: Parameters by key.
        settings: The same as the guidance law knows them.
    """

    since: int
    values: Values
    settings: GuidanceSettings


@dataclass(frozen=True)
class History:
    """All parameters over time.

    Attributes:
        given: Keys that were said; the others are defaults, by which nothing can be judged.
        epochs: In order of time, at least one; the first began before the recording.
    """

    given: frozenset[str]
    epochs: tuple[Epoch, ...]

    def at(self, stamp: int) -> GuidanceSettings:
        """Settings in force at an instant [ns]."""
        index = bisect_right(self.epochs, stamp, key=lambda each: each.since) - 1
        return self.epochs[max(index, 0)].settings


def read_history(bag: Bag, places: Places, sources: Sources) -> History:
    """Parameters of the guidance node, with their recorded changes, or those of a file.

    Raises:
        BagError: The recorded changes cannot be read.
        ParameterError: The parameters cannot be used; names each key.
    """
    if sources.params_file is not None:
        given = load_parameter_file(sources.params_file)
        values = TABLE.resolve(given)
        return History(frozenset(given), (Epoch(0, values, guidance_settings(values)),))
    given = bag.parameters[places.node]
    values = recorded_values(bag, places.node)
    epochs = [Epoch(0, values, guidance_settings(values))]
    for stamp, changes in _changes(bag, places.node):
        try:
            values = TABLE.reconfigure(values, changes)
        except ParameterError as error:
            raise BagError(f'{bag.path}: change of parameters at {stamp} ns: {error}') from error
        epochs.append(Epoch(stamp, values, guidance_settings(values)))
    return History(frozenset(given), tuple(epochs))


def _changes(bag: Bag, node: str) -> list[tuple[int, dict[str, Any]]]:
    changes = []
    for _, event in bag.messages(_EVENTS) if _EVENTS in bag.topics else ():
        values = {each.name: _plain(each.value) for each in event.changed_parameters}
        values = {key: value for key, value in values.items() if not is_of_ros(key)}
        if event.node == node and values:
            changes.append((int(event.stamp.sec) * NANOSECONDS + event.stamp.nanosec, values))
    return changes


def _plain(value: Any) -> Any:
    if not 1 <= value.type <= len(_FIELDS):
        return None
    found = getattr(value, _FIELDS[value.type - 1])
    return found.tolist() if hasattr(found, 'tolist') else found
