"""Numbers that are allowed and look as if they were of another unit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from cmpsp_ros.parameters.table import Values

_LARGEST_LENGTHS: Final = {
    'robot.wheel_radius': 2.0,
    'robot.half_track': 5.0,
    'robot.radius': 10.0,
    'safety.margin': 5.0,
}
"""Beyond what wheeled robots have [m], and far below what the smallest has in millimetres."""

_ANGLES: Final = ('goal.heading', 'goal.heading_tolerance', 'start.pose', 'initial_pose')
"""Angles [rad], or lists of which the last is one."""


def unit_warnings(values: Values) -> Iterator[str]:
    """What looks like millimetres or degrees, in sentences."""
    for key, largest in _LARGEST_LENGTHS.items():
        if values[key] > largest:
            yield f'{key} = {values[key]:g} looks like millimetres: it is in metres.'
    headings = [each for each in values if each.endswith('.heading') and each not in _ANGLES]
    for key in (*_ANGLES, *headings):
        value = values[key]
        angle = (value[-1] if value else 0.0) if isinstance(value, list) else value
        if abs(angle) > math.tau:
            yield f'{key} = {angle:g} looks like degrees: it is in radians.'
