"""The sensors as the parameters describe them, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator

from cmpsp_ros.guidance import SEEN
from cmpsp_ros.parameters.errors import Problem, describe
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.sensing import Sensor, SightSettings


def sight_of(values: Values) -> SightSettings:
    """What sees obstacles, and how that is remembered."""
    return SightSettings(
        tuple(_sensor(values, name) for name in values['sensors.names']),
        values['sight.size'],
        values['sight.resolution'],
        values['sight.memory'],
        values['sight.timeout'],
    )


def sight_problems(values: Values) -> Iterator[Problem]:
    """What is wrong with the sensors."""
    for name in values['sensors.names']:
        low, high = values[f'sensors.{name}.heights']
        if low >= high:
            key = f'sensors.{name}.heights'
            yield Problem(key, describe([low, high]), 'the least z before the greatest')
    if values['sensors.names'] and SEEN in values['obstacles.names']:
        yield Problem('obstacles.names', repr(SEEN), 'another name: it is that of what is seen')


def _sensor(values: Values, name: str) -> Sensor:
    low, high = values[f'sensors.{name}.heights']
    return Sensor(
        name,
        values[f'sensors.{name}.frame_id'],
        tuple(values[f'sensors.{name}.pose']),
        values[f'sensors.{name}.reach'],
        (low, high),
        values[f'sensors.{name}.topic'],
        values[f'sensors.{name}.type'],
    )
