"""Whether a course was given at all, and where it is to begin.

The defaults are a course, and nobody's robot shall drive that by mistake.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator

from cmpsp_ros.parameters.errors import Problem, describe
from cmpsp_ros.parameters.table import Values


def course_problems(values: Values, given: Collection[str]) -> Iterator[Problem]:
    """What is missing before a robot may be driven: a road, and a goal or a speed to follow it.

    Args:
        values: A set resolved by the table.
        given: Keys that the user has said; all others are defaults.
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
