"""Rooms, fields and mazes: walls with doors, furniture, cylinders, and narrow corridors."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import BoolArray
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import Point, Random, Scenario, by_number
from cmpsp_ros.studies.monte_carlo.guesses import grid_path
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, Obstacle, Shape, convex
from cmpsp_ros.world.roads import OpenFloor

THIN: Final = 0.05  # half the thickness of a wall [m]


def shapes(random: Random, center: Point, course: float, name: str) -> list[Shape]:
    """A post, a wall, a crate, or three walls around a pocket that opens towards the start."""
    kind, heading = int(random.integers(4)), random.uniform(-math.pi, math.pi)
    if kind == 0:
        return [Obstacle(name, center, float(random.uniform(0.1, 0.8)))]
    if kind == 1:
        return [box(center, heading, THIN, random.uniform(0.5, 3.0), name)]
    if kind == 2:
        deep, wide = random.uniform(0.3, 1.2, 2).tolist()
        return [box(center, heading, deep, wide, name)]
    wide, deep = random.uniform(0.6, 2.0), random.uniform(0.3, 1.0)
    return pocket(center, course + random.uniform(-0.5, 0.5), wide, deep, name)


def pocket(center: Point, heading: float, wide: float, deep: float, name: str) -> list[Shape]:
    """Three walls, by the middle of the back wall and its outward direction."""
    sides = [moved(center, heading, -deep / 2.0, side * wide / 2.0) for side in (-1.0, 1.0)]
    return [
        box(center, heading, THIN, wide, f'{name}_back'),
        box(sides[0], heading + math.pi / 2.0, THIN, deep, f'{name}_right'),
        box(sides[1], heading + math.pi / 2.0, THIN, deep, f'{name}_left'),
    ]


def box(center: Point, heading: float, deep: float, wide: float, name: str) -> Shape:
    """A wall if it is thin, or else a crate."""
    if deep <= THIN:
        half = max(wide / 2.0 - deep, 0.01)
        ends = (moved(center, heading, 0.0, half), moved(center, heading, 0.0, -half))
        return Capsule(name, *ends, deep)
    corners = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))
    return convex(
        name, [moved(center, heading, a * deep / 2.0, b * wide / 2.0) for a, b in corners]
    )


def moved(point: Point, heading: float, along: float, left: float) -> Point:
    """A point, so far ahead of another and to its left [m]."""
    cosine, sine = math.cos(heading), math.sin(heading)
    return point[0] + along * cosine - left * sine, point[1] + along * sine + left * cosine


_LENGTHS: Final = (8.0, 13.0)
_WIDTHS: Final = (5.0, 9.0)
_FROM_WALL: Final = 0.8
_DOORS: Final = (0.9, 1.6)
_MOST_WALLS: Final = 3
_MOST_SHAPES: Final = 7
_POCKETS: Final = 0.4  # fraction of the rooms with a pocket before the goal
_CLEAR: Final = 0.25  # clearance of start and goal, beyond the robot's radius [m]
SPARE: Final = 0.08  # beside the margin, of the way to the goal [m]


@by_number
def room_scenario(settings: GuidanceSettings, random: Random, _most: int = 0) -> Scenario:
    """A room with a way from start to goal."""
    found = None
    while found is None:
        found = _room(settings, random)
    return found


def _room(settings: GuidanceSettings, random: Random) -> Scenario | None:
    length, width = random.uniform(*_LENGTHS), random.uniform(*_WIDTHS)
    (start_y, goal_y) = random.uniform(_FROM_WALL, width - _FROM_WALL, 2).tolist()
    pose = (_FROM_WALL, start_y, random.uniform(-math.pi, math.pi))
    goal = (length - _FROM_WALL, goal_y)
    obstacles = [*outer_walls(length, width), *_inner_walls(random, length, width)]
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
    return Scenario(pose, tuple(obstacles), {'goal': goal, 'final_time': float(time)})


def outer_walls(length: float, width: float) -> list[Shape]:
    """Walls of a rectangle with a corner at the origin [m]."""
    corners = [(0.0, 0.0), (length, 0.0), (length, width), (0.0, width)]
    ends = zip(corners, corners[1:] + corners[:1], strict=True)
    return [Capsule(f'w{k}', *each, THIN) for k, each in enumerate(ends)]


def _inner_walls(random: Random, length: float, width: float) -> Iterator[Shape]:
    """Walls across the room, each with a door, or a corner that blocks the view."""
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


SIZE: Final = 30  # cells along either side of the field
CELL: Final = 0.15
RADIUS: Final = 0.075
GOAL: Final = (10.0, SIZE * CELL / 2.0)
_BEGIN: Final = 2.75
_BEYOND: Final = 1.0

# Fraction of the cells that are filled at first, from one run to the next.
_FILLED: Final = (0.15, 0.2, 0.25, 0.3)
_GENERATIONS: Final = 5
_CROWDED, _LONELY = 4, 2
_KERNEL: Final = 5
_ATTEMPTS: Final = 50


def field_scenario(settings: GuidanceSettings, seed: int, number: int, _most: int) -> Scenario:
    """A field between two walls, with start and goal beside it."""
    return _field_scenario(settings, seed, number, _FILLED[number % len(_FILLED)])


@by_number
def _field_scenario(settings: GuidanceSettings, random: Random, filled: float) -> Scenario:
    cells = _field(random, filled)
    attempts = 1
    while not is_open(cells):
        # Dense fields are hardly ever open.
        cells = _field(random, filled - 0.01 * (attempts // _ATTEMPTS))
        attempts += 1
    walls = [
        Capsule(f'wall{k}', (-_BEYOND, y), (GOAL[0] + _BEYOND, y), RADIUS)
        for k, y in enumerate((0.0, SIZE * CELL))
    ]
    places = [(_BEGIN + (j + 0.5) * CELL, (i + 0.5) * CELL) for i, j in np.argwhere(cells)]
    cylinders = [Obstacle(f'c{k}', place, RADIUS) for k, place in enumerate(places)]
    pose = (0.0, GOAL[1], 0.0)
    time = math.ceil(GOAL[0] / settings.pace) + 2.0
    changes = {'goal': GOAL, 'final_time': float(time)}
    return Scenario(pose, (*walls, *cylinders), changes)


def is_open(cells: BoolArray) -> bool:
    """True if a square of five cells can cross from one side of a field to the other."""
    from scipy import ndimage  # noqa: PLC0415 (it takes half a second to load)

    windows = np.lib.stride_tricks.sliding_window_view(cells, (_KERNEL, _KERNEL))
    groups, _ = ndimage.label(~windows.any(axis=(2, 3)))
    shared = set(groups[:, 0].tolist()) & set(groups[:, -1].tolist())
    return bool(shared - {0})


def _field(random: Random, filled: float) -> BoolArray:
    cells = random.random((SIZE, SIZE)) < filled
    cells[[0, -1]] = True
    for _ in range(_GENERATIONS):
        count = _neighbours(cells)
        cells = (cells & (count >= _LONELY)) | (count > _CROWDED)
    return cells


def _neighbours(cells: BoolArray) -> NDArray[Any]:
    """Number of filled cells among the eight neighbours; cells beyond the walls are filled."""
    around = np.pad(cells.astype(int), ((1, 1), (0, 0)), constant_values=1)
    around = np.pad(around, ((0, 0), (1, 1)))
    windows = np.lib.stride_tricks.sliding_window_view(around, (3, 3))
    return np.asarray(windows.sum(axis=(2, 3)) - cells)


_SPARE: Final = 0.02  # beside the margin, of the way to the goal [m]
_WIDEST: Final = 2.0  # widest corridor, by the narrowest one that leaves a way
_CELLS: Final = ((3, 6), (2, 5))  # least and greatest number of cells along either side
_REMOVED: Final = 0.1  # fraction of the walls that are missing: there are several ways
_Cell = tuple[int, int]


@by_number
def maze_scenario(settings: GuidanceSettings, random: Random, _most: int) -> Scenario:
    """A maze with a way from one corner to the opposite one."""
    narrowest = 2.0 * (settings.robot_radius + settings.safety.margin + _SPARE)
    while True:
        pitch = narrowest * random.uniform(1.0, _WIDEST) + 2.0 * THIN
        size = tuple(int(random.integers(low, high + 1)) for low, high in _CELLS)
        columns, rows = size
        walls = outer_walls(columns * pitch, rows * pitch)
        walls += _maze_walls(random, (columns, rows), pitch)
        pose = (pitch / 2.0, pitch / 2.0, random.uniform(-math.pi, math.pi))
        goal = ((columns - 0.5) * pitch, (rows - 0.5) * pitch)
        given = replace(settings, obstacles=tuple(walls), goal=goal)
        if len(way := grid_path(given, np.array(pose), _SPARE)):
            break
    length = float(np.hypot(*np.diff(way[:, :2], axis=0).T).sum())
    time = float(math.ceil(length / settings.pace) + 2.0)
    return Scenario(pose, tuple(walls), {'goal': goal, 'final_time': time})


def _maze_walls(random: Random, size: _Cell, pitch: float) -> Iterator[Shape]:
    """Walls between cells that a random tree over all cells does not join."""
    joined, seen, trail = set[tuple[_Cell, _Cell]](), {(0, 0)}, [(0, 0)]
    while trail:
        here = trail[-1]
        beside = [each for each in _cells_beside(here, size) if each not in seen]
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
                inside = other in _cells_beside((x, y), size)
                if inside and ((x, y), other) not in joined and random.uniform() > _REMOVED:
                    ends: tuple[Point, Point] = (
                        (other[0] * pitch, other[1] * pitch),
                        ((x + 1) * pitch, (y + 1) * pitch),
                    )
                    yield Capsule(f'i{x}_{y}_{right}', *ends, THIN)


def _cells_beside(cell: _Cell, size: _Cell) -> list[_Cell]:
    x, y = cell
    found = ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1))
    return [each for each in found if 0 <= each[0] < size[0] and 0 <= each[1] < size[1]]
