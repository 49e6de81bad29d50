"""The sensors as the parameters describe them, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator

from cmpsp_ros.guidance import SEEN
from cmpsp_ros.parameters.errors import Problem, describe
from cmpsp_ros.parameters.parameter import fields_of
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.sensing import Sensor, SightSettings


def sight_of(values: Values) -> SightSettings:
    """What sees obstacles, and how that is remembered."""
    sensors = tuple(
        Sensor(name, **fields_of(Sensor, values, f'sensors.{name}.'))
        for name in values['sensors.names']
    )
    return SightSettings(sensors, **fields_of(SightSettings, values, 'sight.'))


def sight_problems(values: Values) -> Iterator[Problem]:
    """What is wrong with the sensors."""
    for name in values['sensors.names']:
        low, high = values[f'sensors.{name}.heights']
        if low >= high:
            key = f'sensors.{name}.heights'
            yield Problem(key, describe([low, high]), 'the least z before the greatest')
    if values['sensors.names'] and SEEN in values['obstacles.names']:
        yield Problem('obstacles.names', repr(SEEN), 'another name: it is that of what is seen')
