"""The course from parameters: road, obstacles, footprint and goals, each made once and checked.

The default values are a course, too; no robot must drive that one by mistake.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final, Self

import numpy as np

from cmpsp_ros.guidance import GOAL, Follow, Goal
from cmpsp_ros.parameters.errors import Problem, Problems, describe
from cmpsp_ros.parameters.obstacles import obstacles_of
from cmpsp_ros.parameters.roads import ROAD_TYPES, lacks_road, road_of, road_problems
from cmpsp_ros.parameters.robots import FOOTPRINT, footprint_of
from cmpsp_ros.parameters.table import Values
from cmpsp_ros.robots import Footprint
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Point, Shape
from cmpsp_ros.world.roads import OpenFloor, Road

_FEWEST_STEPS: Final = 2
_MOST_STEPS: Final = 1000
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class Course:
    """Road, obstacles and footprint."""

    road: Road  # the road; open floor where it is invalid
    knows_road: bool  # whether it is valid, and no placeholder
    obstacles: tuple[Shape, ...]  # static obstacles, including the map; none where one is invalid
    footprint: Footprint  # the robot's corners, and the discs that cover it
    radius: float  # radius of each of these discs [m]; `radius_name` is its description
    radius_name: str

    @classmethod
    def of(cls, values: Values, problems: Problems) -> Self:
        """Course of a parameter set; invalid parts are problems, an invalid footprint an error."""
        footprint, radius = footprint_of(values)
        name = f'the radius of the discs of {FOOTPRINT}' if footprint.corners else 'robot.radius'
        kept = radius + values['safety.margin']
        road = problems.attempt(partial(road_of, values, kept))
        narrow: list[Problem] = []
        if road is not None:
            wanted = f'more than {name} + safety.margin = {kept:.9g} m'
            narrow = list(road_problems(values, road, kept, wanted))
            problems += narrow
        obstacles = problems.attempt(partial(obstacles_of, values)) or ()
        is_known = road is not None and not narrow and not lacks_road(values)
        return cls(road or OpenFloor(), is_known, obstacles, footprint, radius, name)

    def place_problems(
        self, key: str, point: Point, heading: float | None = None
    ) -> Iterator[Problem]:
        """Problems if the robot, without its margin, cannot be at the point of a key [m], [rad]."""
        road = self.road if self.knows_road else OpenFloor()
        space = FreeSpace.of(road, self.obstacles, self.radius, self.footprint.discs)
        if self.footprint.corners and heading is None:
            space = FreeSpace.of(road, self.obstacles, self.footprint.inscribed)
        clearance = space.at(np.array([[*point, heading or 0.0]]))[0]
        names = (*road.edge_names, *(f'obstacle {each.name}' for each in self.obstacles))
        for name, away in zip(names, clearance.tolist(), strict=True):
            if away < -_ROUNDING:
                found = f'{-away:.3g} m inside or beyond {name}'
                yield Problem(key, found, f'a place where {self.radius_name} is clear')
        if road.beyond(point) > _ROUNDING:
            found = f'{road.beyond(point):.9g} m beyond the end of the road'
            yield Problem(key, found, 'a point between its first and its last point')


def course_problems(values: Values, given: Collection[str]) -> Iterator[Problem]:
    """Problems if the course is incomplete: it needs a road, and a goal or a speed, as `given`."""
    if not any(key.startswith('road.') for key in given):
        types = f'{", ".join(ROAD_TYPES[:-1])} or {ROAD_TYPES[-1]}'
        wanted = f'the road of the course: {types}, with what belongs to it'
        yield Problem('road.type', 'nothing', wanted)
    if not values['follow.speed'] and 'goal.position' not in given:
        yield Problem('goal.position', 'nothing', 'the goal of the course, or follow.speed')


def heading_of(values: Values, key: str) -> float | None:
    """The one number of a list, or None for an empty one [rad]."""
    return values[key][0] if values[key] else None


def waypoints_of(values: Values) -> tuple[Goal, ...]:
    """Goals before the last one."""
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
    """Speed and horizon to follow a closed road with, where that is the task."""
    speed = values['follow.speed']
    return Follow(speed, values['follow.horizon']) if speed else None


def goal_problems(values: Values, course: Course) -> Iterator[Problem]:
    """Problems of goals: blocked positions, invalid headings, times out of order."""
    yield from _one_goal_problems(values, course, 'goal')
    yield from _speed_problems(values, 'goal.nominal_speed')
    if values['goal.when'] == 'soonest' and not values['robot.max_wheel_speed']:
        wanted = 'more than 0, for goal.when = soonest: without a limit any time will do'
        yield Problem('robot.max_wheel_speed', '0.0 rad/s', wanted)
    before, since = 0.0, '0'
    period = values['control_period']
    for name in values['waypoints.names']:
        yield from _one_goal_problems(values, course, f'waypoints.{name}')
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


def follow_problems(values: Values, course: Course) -> Iterator[Problem]:
    """Problems of a road to follow: an end, a speed out of reach, a horizon out of proportion."""
    if values['waypoints.names']:
        found = describe(values['waypoints.names'])
        yield Problem('waypoints.names', found, 'none with follow.speed: a road has no goal')
    if values['goal.when'] != 'fixed':
        wanted = 'fixed with follow.speed: a road has no goal'
        yield Problem('goal.when', repr(values['goal.when']), wanted)
    yield from _speed_problems(values, 'follow.speed')
    horizon, period = values['follow.horizon'], values['control_period']
    if not _FEWEST_STEPS * period <= horizon <= _MOST_STEPS * period:
        wanted = f'{_FEWEST_STEPS} to {_MOST_STEPS} times control_period = {period} s'
        yield Problem('follow.horizon', f'{horizon} s', wanted)
    if not course.knows_road:
        return
    lap, length = course.road.lap, abs(values['follow.speed']) * horizon
    if not lap:
        yield Problem('follow.speed', f'{values["follow.speed"]} m/s', '0 on a road with an end')
    elif length >= lap / 2.0:
        wanted = f'less than half the road, {lap / 2.0:.9g} m'
        yield Problem('follow.horizon', f'{length:.9g} m of way within it', wanted)


def _one_goal_problems(values: Values, course: Course, key: str) -> Iterator[Problem]:
    x, y = values[f'{key}.position']
    heading = values[f'{key}.heading']
    known = heading[0] if len(heading) == 1 else None
    yield from course.place_problems(f'{key}.position', (x, y), known)
    if len(heading) > 1:
        yield Problem(f'{key}.heading', describe(heading), 'a list of one number [rad], or of none')


def _speed_problems(values: Values, key: str) -> Iterator[Problem]:
    top = values['robot.max_wheel_speed'] * values['robot.wheel_radius']
    if 0.0 < top < abs(values[key]):
        wanted = f'at most robot.max_wheel_speed * robot.wheel_radius = {top:.9g} m/s'
        yield Problem(key, f'{values[key]} m/s', wanted)
