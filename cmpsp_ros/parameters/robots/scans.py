"""The simulator's laser scanner from parameters, and its checks."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from cmpsp_ros.parameters.courses.obstacles import shape_problems
from cmpsp_ros.parameters.errors import ParameterError, Problem
from cmpsp_ros.parameters.parameter import fields_of
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.simulator import LaserSettings

OWN_OBSTACLES: Final = 'sim.obstacles'
"""Where obstacles are that only the simulator knows."""


def laser_settings(values: Values) -> LaserSettings:
    """Settings of the simulated scanner.

    Raises:
        ParameterError: Its angles, ranges or times do not fit together, or one of the simulator's
            own obstacles cannot be made.
    """
    problems = [*_scan_problems(values), *shape_problems(values, OWN_OBSTACLES)]
    if problems:
        raise ParameterError(*problems)
    scan = fields_of(LaserSettings, values, 'sim.scan.')
    return LaserSettings(**scan, seed=values['noise.seed'])


def _scan_problems(values: Values) -> Iterator[Problem]:
    first, last = values['sim.scan.angle_min'], values['sim.scan.angle_max']
    if not first < last <= first + math.tau + 1e-9:
        wanted = f'more than sim.scan.angle_min = {first} rad, by a full turn at most'
        yield Problem('sim.scan.angle_max', f'{last} rad', wanted)
    nearest, farthest = values['sim.scan.range_min'], values['sim.scan.range_max']
    if nearest >= farthest:
        wanted = f'more than sim.scan.range_min = {nearest} m'
        yield Problem('sim.scan.range_max', f'{farthest} m', wanted)
    increment, period = values['sim.scan.time_increment'], 1.0 / values['sim.scan.rate']
    longest = period / (values['sim.scan.count'] - 1)
    if increment > longest * (1.0 + 1e-9):
        wanted = f'at most {longest:.9g} s, for a scan within 1 / sim.scan.rate = {period:.9g} s'
        yield Problem('sim.scan.time_increment', f'{increment} s', wanted)
