"""Mazes of corridors, hardly wider than the robot with its margin or several times as wide."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import Point, Scenario
from cmpsp_ros.studies.monte_carlo.courses.rooms import THIN, outer_walls
from cmpsp_ros.studies.monte_carlo.guesses import grid_path
from cmpsp_ros.world.obstacles import Capsule, Shape

_SPARE: Final = 0.02
"""Beside the margin, of the way to the goal [m]."""
_WIDEST: Final = 2.0
"""Widest corridor, by the narrowest one that leaves a way."""
_CELLS: Final = ((3, 6), (2, 5))
"""Least and greatest number of cells along either side."""
_REMOVED: Final = 0.1
"""Fraction of the walls that are missing: there are several ways."""

_Cell = tuple[int, int]


def maze_scenario(
    settings: GuidanceSettings, seed: int, number: int, _most_obstacles: int
) -> Scenario:
    """A maze with a way from one corner to the opposite one; arguments as of `scenario`."""
    random = np.random.default_rng(np.random.SeedSequence([seed, number]))
    plant_seed = int(random.integers(2**31))
    narrowest = 2.0 * (settings.robot_radius + settings.safety.margin + _SPARE)
    while True:
        pitch = narrowest * random.uniform(1.0, _WIDEST) + 2.0 * THIN
        size = tuple(int(random.integers(low, high + 1)) for low, high in _CELLS)
        columns, rows = size
        walls = outer_walls(columns * pitch, rows * pitch)
        walls += _inner_walls(random, (columns, rows), pitch)
        pose = (pitch / 2.0, pitch / 2.0, random.uniform(-math.pi, math.pi))
        goal = ((columns - 0.5) * pitch, (rows - 0.5) * pitch)
        given = replace(settings, obstacles=tuple(walls), goal=goal)
        if len(way := grid_path(given, np.array(pose), _SPARE)):
            break
    length = float(np.hypot(*np.diff(way[:, :2], axis=0).T).sum())
    time = float(math.ceil(length / settings.pace) + 2.0)
    return Scenario(number, pose, tuple(walls), plant_seed, {'goal': goal, 'final_time': time})


def _inner_walls(random: np.random.Generator, size: _Cell, pitch: float) -> Iterator[Shape]:
    """Walls between cells that a random tree over all cells does not join."""
    joined, seen, trail = set[tuple[_Cell, _Cell]](), {(0, 0)}, [(0, 0)]
    while trail:
        here = trail[-1]
        beside = [each for each in _neighbours(here, size) if each not in seen]
        if not beside:
            trail.pop()
            continue
        other = beside[int(random.integers(len(beside)))]
        joined |= {(here, other), (other, here)}
        seen.add(other)
        trail.append(other)
    for x in range(size[0]):
        for y in range(size[1]):
            for right in (1, 0):
                other = (x + right, y + 1 - right)
                inside = other in _neighbours((x, y), size)
                if inside and ((x, y), other) not in joined and random.uniform() > _REMOVED:
                    ends: tuple[Point, Point] = (
                        (other[0] * pitch, other[1] * pitch),
                        ((x + 1) * pitch, (y + 1) * pitch),
                    )
                    yield Capsule(f'i{x}_{y}_{right}', *ends, THIN)


def _neighbours(cell: _Cell, size: _Cell) -> list[_Cell]:
    x, y = cell
    found = ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1))
    return [each for each in found if 0 <= each[0] < size[0] and 0 <= each[1] < size[1]]
