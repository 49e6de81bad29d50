"""Goals from parameters, and their checks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from cmpsp_ros.guidance import GOAL, Follow, Goal
from cmpsp_ros.parameters.courses.course import place_problems
from cmpsp_ros.parameters.courses.roads import known_road
from cmpsp_ros.parameters.errors import Problem, describe
from cmpsp_ros.parameters.table import Values

_FEWEST_STEPS: Final = 2
_MOST_STEPS: Final = 1000
_ROUNDING: Final = 1e-9


def heading_of(values: Values, key: str) -> float | None:
    """The one number of a list, or None for an empty one [rad]."""
    return values[key][0] if values[key] else None


def waypoints_of(values: Values) -> tuple[Goal, ...]:
    """What to pass before the goal."""
    return tuple(
        Goal(
            tuple(values[f'waypoints.{name}.position']),
            values[f'waypoints.{name}.time'],
            heading_of(values, f'waypoints.{name}.heading'),
            name,
        )
        for name in values['waypoints.names']
    )


def follow_of(values: Values) -> Follow | None:
    """How to follow a road without end, where that is the task."""
    speed = values['follow.speed']
    return Follow(speed, values['follow.horizon']) if speed else None


def goal_problems(values: Values) -> Iterator[Problem]:
    """Problems of goals: blocked positions, invalid headings, times out of order."""
    yield from _goal_problems(values, 'goal')
    yield from _speed_problems(values, 'goal.nominal_speed')
    before, since = 0.0, '0'
    period = values['control_period']
    for name in values['waypoints.names']:
        yield from _goal_problems(values, f'waypoints.{name}')
        key, time = f'waypoints.{name}.time', values[f'waypoints.{name}.time']
        if name == GOAL:
            yield Problem('waypoints.names', repr(name), 'another name: it is that of the goal')
        if time < before + period - _ROUNDING:
            wanted = f'{since} + control_period = {before + period:.9g} s or more'
            yield Problem(key, f'{time} s', wanted)
        before, since = time, key
    if values['waypoints.names'] and values['final_time'] < before + period - _ROUNDING:
        wanted = f'{since} + control_period = {before + period:.9g} s or more'
        yield Problem('final_time', f'{values["final_time"]} s', wanted)


def follow_problems(values: Values) -> Iterator[Problem]:
    """A road with an end, a speed beyond the robot's, a horizon too short or too long."""
    if values['waypoints.names']:
        found = describe(values['waypoints.names'])
        yield Problem('waypoints.names', found, 'none with follow.speed: a road has no goal')
    yield from _speed_problems(values, 'follow.speed')
    horizon, period = values['follow.horizon'], values['control_period']
    if not _FEWEST_STEPS * period <= horizon <= _MOST_STEPS * period:
        wanted = f'{_FEWEST_STEPS} to {_MOST_STEPS} times control_period = {period} s'
        yield Problem('follow.horizon', f'{horizon} s', wanted)
    road = known_road(values)
    if road is None:
        return
    if not road.lap:
        yield Problem('follow.speed', f'{values["follow.speed"]} m/s', '0 on a road with an end')
        return
    if abs(values['follow.speed']) * horizon >= road.lap / 2.0:
        found = f'{abs(values["follow.speed"]) * horizon:.9g} m of way within it'
        yield Problem('follow.horizon', found, f'less than half the road, {road.lap / 2.0:.9g} m')


def _goal_problems(values: Values, key: str) -> Iterator[Problem]:
    x, y = values[f'{key}.position']
    heading = values[f'{key}.heading']
    known = heading[0] if len(heading) == 1 else None
    yield from place_problems(values, f'{key}.position', (x, y), known)
    if len(heading) > 1:
        yield Problem(f'{key}.heading', describe(heading), 'a list of one number [rad], or of none')


def _speed_problems(values: Values, key: str) -> Iterator[Problem]:
    top = values['robot.max_wheel_speed'] * values['robot.wheel_radius']
    if 0.0 < top < abs(values[key]):
        wanted = f'at most robot.max_wheel_speed * robot.wheel_radius = {top:.9g} m/s'
        yield Problem(key, f'{values[key]} m/s', wanted)
