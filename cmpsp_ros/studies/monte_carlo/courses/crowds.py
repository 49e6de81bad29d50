"""Places with people who walk about: a hall, furnished rooms, corridors, crossings and doors."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.simulator import PeopleSettings, Walker
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import Point, Random, Scenario
from cmpsp_ros.studies.monte_carlo.courses.rooms import THIN, outer_walls, room_scenario
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, Shape
from cmpsp_ros.world.roads import OpenFloor

_SPEEDS, _HALL_SPEEDS = (0.3, 1.6), (0.3, 1.2)
_RADIUS: Final = 0.25
_FROM_START: Final = 2.0  # least distance of people from the robot's start [m]
_FROM_WALL, _BESIDE = 0.1, 0.7
_ATTEMPTS: Final = 200


@dataclass(frozen=True)
class _Place:
    """Walls, start and goal [m], and walkers on drawn paths; `most` further ones walk anywhere."""

    obstacles: tuple[Shape, ...]
    start: Point
    goal: Point
    walkers: tuple[Walker, ...] = ()
    most: int = 0


def crowd_scenario(settings: GuidanceSettings, seed: int, number: int, scene: str) -> Scenario:
    """A scene of that name with people, half of whom look at no robot, by seed and number."""
    random = np.random.default_rng(np.random.SeedSequence([seed, number]))
    plant_seed = int(random.integers(2**31))
    place = SCENES[scene](random, settings, seed, number)
    walkers = [*place.walkers, *_strollers(random, place)]
    people = PeopleSettings(tuple(walkers), seed=plant_seed)
    heading = random.uniform(-0.5, 0.5) if scene != 'room' else random.uniform(-math.pi, math.pi)
    time = math.ceil(math.dist(place.start, place.goal) / settings.pace) + 2.0
    changes = {'goal': place.goal, 'final_time': float(time)}
    pose = (*place.start, float(heading))
    return Scenario(pose, place.obstacles, changes, people, number, plant_seed)


def _hall(random: Random, *_run: object) -> _Place:
    """12 m by 6 m, with four people who walk straight on and look at no robot."""
    start, goal = ((x, float(random.uniform(1.0, 5.0))) for x in (0.8, 11.2))
    walkers = list[Walker]()
    while len(walkers) < 4:
        position = float(random.uniform(0.5, 11.5)), float(random.uniform(0.5, 5.5))
        heading, speed = random.uniform(-math.pi, math.pi), random.uniform(*_HALL_SPEEDS)
        if math.dist(position, start) >= _FROM_START:
            name = f'p{len(walkers) + 1}'
            walkers.append(_straight(name, position, float(heading), float(speed)))
    return _Place(tuple(outer_walls(12.0, 6.0)), start, goal, tuple(walkers))


def _room(_random: Random, settings: GuidanceSettings, seed: int, number: int) -> _Place:
    """A furnished room of the study `sight`, with up to twelve people."""
    made = room_scenario(settings, seed, number)
    return _Place(made.obstacles, made.pose[:2], made.changes['goal'], most=12)


def _corridor(random: Random, settings: GuidanceSettings, *_run: int) -> _Place:
    """A corridor with people along it, in both directions."""
    length, width = 14.0, float(random.uniform(2.0, 3.5) + 2.0 * settings.robot_radius)
    start, goal = ((x, _within(random, width, 0.8)) for x in (0.8, length - 0.8))
    walkers = []
    for index in range(int(random.integers(1, 7))):
        count = 2 if random.uniform() < 0.2 else 1
        # The second walks to the left of the first.
        lane = _within(random, width - _BESIDE * (count - 1), 0.5)
        ends = [(0.5, lane), (length - 0.5, lane)]
        if random.uniform() < 0.5:
            ends.reverse()
        begin = float(random.uniform(4.0, length - 1.0)), lane
        walkers.append(_wanderer(random, f'p{index + 1}', [begin, *ends], count))
    return _Place(tuple(outer_walls(length, width)), start, goal, tuple(walkers))


def _crossing(random: Random, settings: GuidanceSettings, *_run: int) -> _Place:
    """Two corridors that cross: people come out of the other one."""
    size = 12.0
    wide, other = (float(random.uniform(1.8, 3.0)) + 2.0 * settings.robot_radius for _ in range(2))
    low, high = (size - wide) / 2.0, (size + wide) / 2.0
    left, right = (size - other) / 2.0, (size + other) / 2.0
    lines = [
        ((0.0, low), (left, low)), ((right, low), (size, low)),
        ((0.0, high), (left, high)), ((right, high), (size, high)),
        ((left, 0.0), (left, low)), ((left, high), (left, size)),
        ((right, 0.0), (right, low)), ((right, high), (right, size)),
        ((0.0, low), (0.0, high)), ((size, low), (size, high)),
        ((left, 0.0), (right, 0.0)), ((left, size), (right, size)),
    ]  # fmt: skip
    walls = tuple(Capsule(f'w{k}', *ends, THIN) for k, ends in enumerate(lines))
    start, goal = ((x, low + _within(random, wide, 0.7)) for x in (0.8, size - 0.8))
    walkers = []
    for index in range(int(random.integers(1, 9))):
        if random.uniform() < 0.7:
            lane = left + _within(random, other, 0.5)
            ends = [(lane, 0.5), (lane, size - 0.5)]
            begin = lane, float(random.uniform(0.5, size - 0.5))
        else:
            lane = low + _within(random, wide, 0.5)
            ends = [(0.5, lane), (size - 0.5, lane)]
            begin = float(random.uniform(4.0, size - 0.5)), lane
        if random.uniform() < 0.5:
            ends.reverse()
        walkers.append(_wanderer(random, f'p{index + 1}', [begin, *ends]))
    return _Place(walls, start, goal, tuple(walkers))


def _door(random: Random, settings: GuidanceSettings, *_run: int) -> _Place:
    """Two rooms with a door between them, and people who go through it in both directions."""
    length, width = 12.0, 6.0
    door = float(random.uniform(1.0, 1.8) + 2.0 * settings.robot_radius)
    middle = float(random.uniform(0.3, 0.7)) * width
    x = length / 2.0
    walls = [
        *outer_walls(length, width),
        Capsule('low', (x, 0.0), (x, middle - door / 2.0), THIN),
        Capsule('high', (x, middle + door / 2.0), (x, width), THIN),
    ]
    start, goal = ((each, _within(random, width, 1.0)) for each in (0.8, length - 0.8))
    walkers = []
    for index in range(int(random.integers(1, 7))):
        ends = [(each, _within(random, width, 0.6)) for each in (1.5, length - 1.5)]
        if random.uniform() < 0.7 or math.dist(ends[0], start) < _FROM_START:
            ends.reverse()
        through = middle + float(random.uniform(-0.5, 0.5)) * (door - 1.0)
        before = 0.8 if ends[0][0] > x else -0.8
        path = [ends[0], (x + before, through), (x - before, through), ends[1]]
        walkers.append(_wanderer(random, f'p{index + 1}', path))
    return _Place(tuple(walls), start, goal, tuple(walkers))


# Scenes by name, in the order in which runs take them.
SCENES: Final[dict[str, Callable[..., _Place]]] = {
    'hall': _hall,
    'room': _room,
    'corridor': _corridor,
    'crossing': _crossing,
    'door': _door,
}


def _strollers(random: Random, place: _Place) -> list[Walker]:
    """People who walk anywhere in a place, clear of walls and of the robot's start."""
    if not place.most:
        return []
    space = FreeSpace.of(OpenFloor(), place.obstacles, _RADIUS + _FROM_WALL)
    length, width = place.obstacles[2].corners[0]
    walkers, wanted = list[Walker](), int(random.integers(1, place.most + 1))
    for _ in range(_ATTEMPTS):
        if len(walkers) == wanted:
            break
        x, y = random.uniform(0.0, (length, width)).tolist()
        clear = space.at(np.array([[x, y, 0.0]]))[:, 2:].min() > 0.0
        apart = all(math.dist((x, y), each.position) > 2.0 * _RADIUS for each in walkers)
        if not (clear and apart and math.dist((x, y), place.start) >= _FROM_START):
            continue
        name, speed = f'p{len(walkers) + 1}', float(random.uniform(*_SPEEDS))
        if random.uniform() < 0.5:
            walkers.append(_straight(name, (x, y), float(random.uniform(-math.pi, math.pi)), speed))
        else:
            walkers.append(Walker(name, (x, y), 'random', speed=speed, radius=_RADIUS))
    return walkers


def _straight(name: str, position: Point, heading: float, speed: float) -> Walker:
    return Walker(name, position, heading=heading, speed=speed, radius=_RADIUS, gives_way=False)


def _wanderer(random: Random, name: str, points: Sequence[Point], count: int = 1) -> Walker:
    """Somebody on the way from the first point to the next, there and back."""
    flat = tuple(coordinate for point in points[1:] for coordinate in point)
    return Walker(
        name, points[0], 'waypoints', waypoints=flat, speed=float(random.uniform(*_SPEEDS)),
        radius=_RADIUS, gives_way=bool(random.uniform() < 0.5), count=count,
    )  # fmt: skip


def _within(random: Random, width: float, away: float) -> float:
    return float(random.uniform(away, width - away))
