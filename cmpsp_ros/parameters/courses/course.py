"""Whether a course was given, and where a robot may be on it.

The default values are a course, too; no robot must drive that one by mistake.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from cmpsp_ros.parameters.courses.obstacles import in_obstacle_problems
from cmpsp_ros.parameters.courses.roads import off_road_problems
from cmpsp_ros.parameters.errors import Problem, describe
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.world.obstacles.shapes import Point


def course_problems(values: Values, given: Collection[str]) -> Iterator[Problem]:
    """Problems if the course is incomplete: it needs a road, and a goal or a speed to follow it.

    Args:
        values: A set resolved by the table.
        given: Keys given by the user; all others are defaults.
    """
    if not any(key.startswith('road.') for key in given):
        wanted = 'the road of the course: annulus, corridor or none, with what belongs to it'
        yield Problem('road.type', 'nothing', wanted)
    if not values['follow.speed'] and 'goal.position' not in given:
        yield Problem('goal.position', 'nothing', 'the goal of the course, or follow.speed')


def start_problems(values: Values) -> Iterator[Problem]:
    """A start that is no pose."""
    pose = values['start.pose']
    if len(pose) not in (0, 3):
        yield Problem('start.pose', describe(pose), 'x, y and heading, or none of them')


def place_problems(values: Values, key: str, point: Point) -> Iterator[Problem]:
    """Problems if the robot, without its margin, cannot be at a point [m]."""
    yield from off_road_problems(values, key, point)
    yield from in_obstacle_problems(values, key, point)
