"""Random rooms that a robot knows nothing of: walls with doors, corners, pockets and furniture."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.monte_carlo.courses.furniture import THIN, box, moved, pocket, shapes
from cmpsp_ros.studies.monte_carlo.courses.scenario import Point, Scenario
from cmpsp_ros.studies.monte_carlo.judging.grid_search import grid_path
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, Shape
from cmpsp_ros.world.roads import OpenFloor

_Random = np.random.Generator

_LENGTHS: Final = (8.0, 13.0)
_WIDTHS: Final = (5.0, 9.0)
_FROM_WALL: Final = 0.8
_DOORS: Final = (0.9, 1.6)
_MOST_WALLS: Final = 3
_MOST_SHAPES: Final = 7
_POCKETS: Final = 0.4
"""Fraction of the rooms with a pocket before the goal."""

_CLEAR: Final = 0.25
"""Of start and goal, beyond the robot's radius [m]."""

SPARE: Final = 0.08
"""Beside the margin, of the way to the goal [m]."""


def room_scenario(
    settings: GuidanceSettings, seed: int, number: int, _most_obstacles: int
) -> Scenario:
    """A room with a way from start to goal; arguments as of `scenario`."""
    random = np.random.default_rng(np.random.SeedSequence([seed, number]))
    plant_seed, found = int(random.integers(2**31)), None
    while found is None:
        found = _room(settings, random, number, plant_seed)
    return found


def _room(
    settings: GuidanceSettings, random: _Random, number: int, plant_seed: int
) -> Scenario | None:
    """A room, or none where no way leads to the goal."""
    length, width = random.uniform(*_LENGTHS), random.uniform(*_WIDTHS)
    (start_y, goal_y) = random.uniform(_FROM_WALL, width - _FROM_WALL, 2).tolist()
    pose = (_FROM_WALL, start_y, random.uniform(-math.pi, math.pi))
    goal = (length - _FROM_WALL, goal_y)
    obstacles = [*_outer_walls(length, width), *_inner_walls(random, length, width)]
    if random.uniform() < _POCKETS:
        course = math.atan2(goal[1] - pose[1], goal[0] - pose[0])
        center = moved(goal, course, -random.uniform(1.0, 3.0), random.uniform(-0.5, 0.5))
        obstacles += pocket(center, course, random.uniform(1.0, 3.0), random.uniform(0.5, 2.0), 'p')
    for index in range(int(random.integers(2, _MOST_SHAPES + 1))):
        center = (random.uniform(1.5, length - 1.5), random.uniform(0.0, width))
        obstacles += shapes(random, center, random.uniform(-math.pi, math.pi), f'o{index + 1}')
    ends = np.array([pose, (*goal, 0.0)])
    away = FreeSpace.of(OpenFloor(), obstacles, settings.robot_radius).at(ends)[:, 2:]
    if away.min() < _CLEAR:
        return None
    given = replace(settings, obstacles=tuple(obstacles), goal=goal)
    if not len(grid_path(given, np.array(pose), SPARE)):
        return None
    time = math.ceil(math.dist(pose[:2], goal) / settings.pace) + 2.0
    return Scenario(
        number, pose, tuple(obstacles), plant_seed, {'goal': goal, 'final_time': float(time)}
    )


def _outer_walls(length: float, width: float) -> list[Shape]:
    corners = [(0.0, 0.0), (length, 0.0), (length, width), (0.0, width)]
    ends = zip(corners, corners[1:] + corners[:1], strict=True)
    return [Capsule(f'w{k}', *each, THIN) for k, each in enumerate(ends)]


def _inner_walls(random: _Random, length: float, width: float) -> Iterator[Shape]:
    """Walls across the room, each with a door, or a corner that hides what is behind it."""
    count = int(random.integers(1, _MOST_WALLS + 1))
    for index in range(count):
        x = length * (index + random.uniform(0.8, 1.2)) / (count + 1.0)
        door = random.uniform(*_DOORS)
        low = random.uniform(0.3, width - door - 0.3)
        tilt = random.uniform(-0.2, 0.2)
        parts: list[tuple[Point, float]] = [
            ((x, low / 2.0), low),
            ((x, (low + door + width) / 2.0), width - low - door),
        ]
        if random.uniform() < 0.5:
            del parts[int(random.integers(2))]
        for k, (center, wide) in enumerate(parts):
            yield box(center, tilt, THIN, wide, f'i{index}{k}')
