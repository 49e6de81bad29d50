"""Where the obstacles are, and where the robot may stand."""

from __future__ import annotations

import math
from collections.abc import Iterator

from cmpsp_ros.parameters.errors import Problem
from cmpsp_ros.parameters.roads import off_road_problems
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.robot.obstacles import Obstacle


def obstacles_of(values: Values) -> tuple[Obstacle, ...]:
    """The obstacles.

    Args:
        values: A set resolved by the table.
    """
    return tuple(
        Obstacle(
            name,
            tuple(values[f'obstacles.{name}.center']),
            values[f'obstacles.{name}.radius'],
        )
        for name in values['obstacles.names']
    )


def place_problems(values: Values, key: str, point: tuple[float, float]) -> Iterator[Problem]:
    """What forbids the robot, without its margin, to stand at a point [m]."""
    yield from off_road_problems(values, key, point)
    radius = values['robot.radius']
    for obstacle in obstacles_of(values):
        distance, needed = math.dist(point, obstacle.center), obstacle.radius + radius
        if distance < needed:
            found = f'{distance:.9g} m from the centre of obstacle {obstacle.name}'
            wanted = f'{needed:.9g} m or more (obstacles.{obstacle.name}.radius + robot.radius)'
            yield Problem(key, found, wanted)
