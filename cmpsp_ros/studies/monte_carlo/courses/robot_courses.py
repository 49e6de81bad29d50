"""The courses of case 3 for other robots: in proportion to their speed and size, in their time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.robots import Robot
from cmpsp_ros.studies.monte_carlo.courses.scenario import WIDTH, Scenario, scenario

_TOP_SPEED, _WHEEL_SPEED, _ROAD_CENTER = 1.785, 51.0, 15.0
"""Of case 3 [m/s, rad/s, 1/m^2]."""

_THOROUGH: Final = {'solver.iterations_per_step': 4, 'solver.work_share': 0.3}

_RADII_WIDE: Final = 4.0
"""Width of the ring in radii of the robot, at least."""

_AHEAD: Final = 2.0
"""Angle of the ring from start to goal, at most [rad]."""

_PACE: Final = (0.5, 0.75)
"""Fraction of the top speed that the shortest way takes."""


def in_proportion(robot: Robot, given: Mapping[str, Any], radius: float) -> dict[str, Any]:
    """Changes of the parameters of case 3 that make it a course for a robot.

    The weight of the centre line keeps its proportion to that of changes of the controls.

    Args:
        robot: The robot.
        given: Parameters of case 3.
        radius: Of its footprint [m].
    """
    scale = max(robot.max_speed / _TOP_SPEED, _RADII_WIDE * radius / WIDTH)
    unit = float(np.abs(robot.controls(np.array([robot.max_speed, 0.0]))).max()) / _WHEEL_SPEED
    return {
        'road.inner_radius': scale * given['road.inner_radius'],
        'road.outer_radius': scale * given['road.outer_radius'],
        'goal.position': [scale * each for each in given['goal.position']],
        # As modelled, it stops as modelled.
        'safety.stopping_time': 0.0,
        'weights.road_center': _ROAD_CENTER * (unit / scale) ** 2,
        **_THOROUGH,
    }


def robot_scenario(
    settings: GuidanceSettings, seed: int, number: int, most_obstacles: int
) -> Scenario:
    """A scenario with the time that the robot needs; arguments as of `scenario`."""
    x, y = settings.goal
    bearing = math.atan2(y, x)
    made = scenario(settings, seed, number, most_obstacles, (bearing - _AHEAD, bearing + _AHEAD))
    random = np.random.default_rng(np.random.SeedSequence([seed, number, 1]))
    robot, period = settings.robot, settings.control_period
    speed = float(random.uniform(*_PACE)) * robot.max_speed
    way = settings.road.shortest_length(made.pose[:2], settings.goal)
    # Half of the way is lost until a robot that accelerates evenly has its speed.
    time = way / speed + speed / robot.max_acceleration + period
    changes = {'final_time': round(math.ceil(time / period) * period, 6)}
    return replace(made, changes=changes)
