"""Where the robot may stand."""

from __future__ import annotations

from collections.abc import Iterator

from cmpsp_ros.parameters.errors import Problem
from cmpsp_ros.parameters.obstacles import in_obstacle_problems
from cmpsp_ros.parameters.roads import off_road_problems
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.world.obstacles.shapes import Point


def place_problems(values: Values, key: str, point: Point) -> Iterator[Problem]:
    """What forbids the robot, without its margin, to stand at a point [m]."""
    yield from off_road_problems(values, key, point)
    yield from in_obstacle_problems(values, key, point)
