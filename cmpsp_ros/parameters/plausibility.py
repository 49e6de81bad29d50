"""Values that are valid but probably a mistake: in the wrong unit, or inconsistent."""

import math
from collections.abc import Iterator
from typing import Final

from cmpsp_ros.parameters.roads import unused_road_keys
from cmpsp_ros.parameters.robots import footprint_of
from cmpsp_ros.parameters.table import Values

_LARGEST_LENGTHS: Final = {
    'robot.wheel_radius': 2.0,
    'robot.half_track': 5.0,
    'robot.radius': 10.0,
    'safety.margin': 5.0,
    'goal.tolerance': 5.0,
    'others.radius': 10.0,
}
"""Beyond what wheeled robots have [m], and far below what the smallest has in millimetres."""

_LONGEST_BRAKING: Final = 5.0  # longest time that a robot on wheels brakes for [s]
_ANGLES: Final = (
    *('goal.heading', 'goal.heading_tolerance', 'start.pose', 'initial_pose'),
    'solver.heading_trust_region',
)
"""Angles [rad], or lists of which the last is one."""


def millimetres(values: Values) -> list[str]:
    """Keys of lengths that look like millimetres."""
    return [key for key, largest in _LARGEST_LENGTHS.items() if values[key] > largest]


def plausibility_warnings(values: Values) -> Iterator[str]:
    """Warnings about values that look like millimetres or degrees, or cannot fit together."""
    for key in millimetres(values):
        yield f'{key} = {values[key]:g} looks like millimetres: it is in metres.'
    corners = footprint_of(values)[0].corners
    if any(abs(each) > _LARGEST_LENGTHS['robot.radius'] for corner in corners for each in corner):
        yield 'robot.footprint looks like millimetres: it is in metres.'
    if corners and values['robot.radius']:
        yield 'robot.radius does not count: robot.footprint says what the robot takes up.'
    for key in unused_road_keys(values):
        yield f'{key} does not count: road.type is {values["road.type"]}.'
    limit, acceleration = values['robot.max_wheel_speed'], values['robot.max_wheel_acceleration']
    if limit > _LONGEST_BRAKING * acceleration > 0.0:
        yield (
            f'robot.max_wheel_acceleration = {acceleration:g} looks like m/s^2, it is in rad/s^2:'
            f' from full speed the robot would brake for {limit / acceleration:.3g} s.'
        )
    headings = [each for each in values if each.endswith(('.heading', '.pose'))]
    for key in dict.fromkeys((*_ANGLES, *headings)):
        value = values[key]
        angle = (value[-1] if value else 0.0) if isinstance(value, list) else value
        if abs(angle) > math.tau:
            radians = f'{math.radians(angle):.6g}'
            yield f'{key} = {angle:g} looks like degrees: it is in radians ({radians}).'
    timeout, period = values['cmd_vel_timeout'], values['control_period']
    if 0.0 < timeout <= period:
        yield (
            f'control_period = {period:g} s is not shorter than cmd_vel_timeout = {timeout:g} s:'
            ' the robot stops by itself between two commands.'
        )
