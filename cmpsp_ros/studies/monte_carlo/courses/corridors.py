"""Random corridors and floors with walls, crates and posts, each with a path through."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import (
    GAP,
    Point,
    Random,
    Scenario,
    by_number,
)
from cmpsp_ros.studies.monte_carlo.courses.rooms import THIN, box, moved, pocket, shapes
from cmpsp_ros.studies.monte_carlo.guesses import grid_path
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import Corridor, OpenFloor, Road, lookahead_point

_POINTS: Final = 5
_SPACING: Final = 2.5
_LARGEST_TURN: Final = math.radians(25.0)
_HALF_WIDTHS: Final = (0.6, 1.4)
# From one obstacle on a corridor to the next, and from the ends to the first and the last [m].
_APART: Final = (1.6, 2.6)
_FROM_END: Final = 1.2
_HEADINGS: Final = math.pi / 2.0
# Fraction of the top speed that is needed for the straight path, and length added to it [m].
_PACE: Final = (0.5, 0.75)
_DETOUR: Final = 3.0
_CLEAR: Final = 0.4
# Fraction of the floors on which start or goal lies in a dead end, and how far from its back [m].
_DEAD_ENDS: Final = 0.3
_FROM_BACK: Final = 0.6
_ATTEMPTS: Final = 1000


class _Course(NamedTuple):
    """A road, its start and goal, its obstacles, and its approximate length [m]."""

    road: Road
    pose: tuple[float, float, float]
    goal: Point
    obstacles: Sequence[Shape]
    length: float


@by_number
def corridor_scenario(settings: GuidanceSettings, random: Random, most_obstacles: int) -> Scenario:
    """A bent corridor of unequal widths with walls and crates, each with a `GAP` beside it."""
    road = _corridor(random)
    needed, length = GAP + 2.0 * settings.robot_radius, road.length
    (x, y, heading), _ = _place(road, 0.5)
    (*goal, _), _ = _place(road, length - 0.5)
    obstacles, at = list[Shape](), 0.5 + _FROM_END
    for index in range(int(random.integers(1, max(most_obstacles, 1) + 1))):
        at += random.uniform(0.0, 1.0) if index == 0 else random.uniform(*_APART)
        if at > length - 0.5 - _FROM_END:
            break
        obstacles.append(_across(random, road, at, needed, f'o{index + 1}'))
    pose = (x, y, heading + random.uniform(-_HEADINGS, _HEADINGS))
    course = _Course(road, pose, (goal[0], goal[1]), obstacles, length)
    return _scenario(settings, random, course)


@by_number
def floor_scenario(settings: GuidanceSettings, random: Random, most_obstacles: int) -> Scenario:
    """Open floor with walls, crates, posts and groups of them, and dead ends."""
    distance, course = random.uniform(6.0, 9.0), random.uniform(-math.pi, math.pi)
    goal = (distance * math.cos(course), distance * math.sin(course))
    pose = (0.0, 0.0, course + random.uniform(-_HEADINGS, _HEADINGS))
    obstacles: list[Shape] = []
    ends = np.array([[*pose], [*goal, 0.0]])
    for index in range(int(random.integers(1, max(most_obstacles, 1) + 1))):
        for _ in range(_ATTEMPTS):
            along, across = random.uniform(1.0, distance - 1.0), random.normal(0.0, 0.6)
            center = moved((0.0, 0.0), course, along, across)
            drawn = shapes(random, center, course, f'o{index + 1}')
            away = FreeSpace.of(OpenFloor(), drawn, settings.robot_radius).at(ends)[:, 2:]
            if away.min() >= _CLEAR:
                obstacles += drawn
                break
    if random.uniform() < _DEAD_ENDS:
        end, heading = (pose[:2], goal)[int(random.integers(2))], random.uniform(-math.pi, math.pi)
        back, (wide, deep) = moved(end, heading, _FROM_BACK, 0.0), random.uniform(1.4, 2.0, 2)
        obstacles = [*pocket(back, heading, float(wide), float(deep), 'end'), *obstacles]
        distance += 2.0 * float(deep) + _DETOUR
    whole = _Course(OpenFloor(), pose, goal, obstacles, distance + _DETOUR)
    made = _scenario(settings, random, whole)
    # Several together may leave no way, for a robot that keeps a little beside its margin.
    while True:
        given = replace(settings, obstacles=made.obstacles, **made.changes)
        if len(grid_path(given, np.array(pose), GAP / 2.0 - settings.safety.margin)):
            return made
        made = replace(made, obstacles=made.obstacles[:-1])


def _scenario(settings: GuidanceSettings, random: Random, course: _Course) -> Scenario:
    pace, period = random.uniform(*_PACE) * settings.robot.max_speed, settings.control_period
    time = round(math.ceil(course.length / pace / period) * period, 6)
    changes = {'road': course.road, 'goal': course.goal, 'final_time': time}
    return Scenario(course.pose, tuple(course.obstacles), changes)


def _corridor(random: Random) -> Corridor:
    course, points = random.uniform(-math.pi, math.pi), [(0.0, 0.0)]
    for _ in range(_POINTS - 1):
        points.append(moved(points[-1], course, _SPACING, 0.0))
        course += random.uniform(-_LARGEST_TURN, _LARGEST_TURN)
    left, right = (float(each) for each in random.uniform(*_HALF_WIDTHS, 2))
    narrower = random.uniform(0.8, 1.0, (2, _POINTS))
    widths = narrower * np.array([[left], [right]])
    return Corridor(tuple(points), tuple(widths[0].tolist()), tuple(widths[1].tolist()))


def _place(road: Corridor, at: float) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """A pose on the centre line at some progress [m], and the widths to its left and right [m]."""
    begin = np.array([*road.points[0], math.nan])
    (x, y), heading = lookahead_point(road, begin, at, 0.0)
    clearance = FreeSpace.of(road, (), 0.0).at(np.array([[x, y, heading]]))[0]
    return (x, y, heading), (float(clearance[0]), float(clearance[1]))


def _across(random: Random, road: Corridor, at: float, gap: float, name: str) -> Shape:
    """Something on the road that leaves a gap to its left or to its right, or both."""
    (x, y, heading), (left, right) = _place(road, at)
    tilted = heading + random.uniform(-0.3, 0.3)
    # From where to where it reaches, to the left of the centre line.
    kind, side = int(random.integers(4)), random.choice([-1.0, 1.0])
    if kind < 2:
        # From an edge: a wall, or a crate that blocks the side.
        whole = left + right
        reach = random.uniform(0.3, max(whole - gap - 0.2, 0.31))
        ends = (left + 0.3, left - reach) if side > 0.0 else (-right - 0.3, -right + reach)
        low, high = min(ends), max(ends)
        deep = THIN if kind == 0 else random.uniform(0.3, 0.8)
        return box(moved((x, y), heading, 0.0, (low + high) / 2.0), heading, deep, high - low, name)
    # On the centre line: a wall across it, or a crate. The wider side has the gap.
    most = 2.0 * (max(left, right) - gap - 0.15)
    size = min(random.uniform(0.3, 1.2), max(most, 0.1))
    deep = THIN if kind == 2 else random.uniform(0.2, 0.8)
    return box((x, y), tilted if size < 0.6 else heading, deep, size, name)
