"""Courses on a ring: random obstacles, the paper's, and those in proportion to other robots.

Lengths are those of a ring 2 m wide; on a wider one they grow with it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.robots import Robot
from cmpsp_ros.simulator import PeopleSettings
from cmpsp_ros.world.obstacles import Obstacle, Shape
from cmpsp_ros.world.roads import Annulus

WIDTH: Final = 2.0  # width of the ring of case 3 [m]

# Least distance of the start from road edges, and of start and goal from obstacles [m].
FROM_EDGE: Final = 0.05
GAP: Final = 0.4  # width that obstacles leave free all along the road [m]
RADII: Final = (0.1, 0.8)  # least and greatest radius of an obstacle [m]
_BEYOND: Final = 0.5  # angle by which obstacles may lie behind the start and past the goal [rad]
_ATTEMPTS: Final = 1000

# Those of case 3.
_PAPER_OBSTACLES: Final = (Obstacle('a', (8.0, -6.0), 0.7), Obstacle('b', (10.0, -2.0), 0.5))
_STARTS: Final = -9.6, -9.1  # ordinates around the paper's -9.25 [m]
_ASKEW: Final = 0.3  # largest heading at the start; the paper's is 0 [rad]
Point = tuple[float, float]
Random = np.random.Generator


@dataclass(frozen=True)
class Scenario:
    """The random part of a run: initial pose [m, m, rad], obstacles and people, if any."""

    pose: tuple[float, float, float]
    obstacles: tuple[Shape, ...]
    # Settings of the law that differ from the study's.
    changes: Mapping[str, Any] = field(default_factory=dict)
    people: PeopleSettings | None = None
    number: int = 0
    seed: int = 0  # of the plant


def by_number(draw: Callable[..., Scenario]) -> Callable[..., Scenario]:
    """Scenario by settings, seed and number of a run, and further arguments, drawn at random."""

    @wraps(draw)
    def drawn(settings: GuidanceSettings, seed: int, number: int, *further: Any) -> Scenario:
        random = np.random.default_rng(np.random.SeedSequence([seed, number]))
        plant_seed = int(random.integers(2**31))
        return replace(draw(settings, random, *further), number=number, seed=plant_seed)

    return drawn


@by_number
def scenario(
    settings: GuidanceSettings,
    random: Random,
    most_obstacles: int,
    bearings: tuple[float, float] = (0.0, math.tau),
) -> Scenario:
    """A scenario with random obstacles, and a start within a range of bearings [rad]."""
    road, goal = settings.world.annulus, settings.goal
    scale = (road.outer_radius - road.inner_radius) / WIDTH
    away = settings.robot_radius + scale * FROM_EDGE
    start = _point(random, road, bearings, away)
    ahead = road.angle_between(start, goal)
    bearing = math.atan2(start[1] - road.center[1], start[0] - road.center[0])
    along = bearing + math.copysign(math.pi / 2.0, ahead)
    heading = math.remainder(along + random.uniform(-math.pi / 2.0, math.pi / 2.0), math.tau)
    beyond = math.copysign(_BEYOND, ahead)
    first, last = sorted((bearing - beyond, bearing + ahead + beyond))
    wanted, obstacles = int(random.integers(most_obstacles + 1)), list[Obstacle]()
    for _ in range(_ATTEMPTS):
        if len(obstacles) == wanted:
            break
        place = _point(random, road, (first, last), 0.0)
        radius = scale * float(random.uniform(*RADII))
        drawn = Obstacle(f'o{len(obstacles) + 1}', place, radius)
        clear = all(math.dist(each, drawn.center) >= drawn.radius + away for each in (start, goal))
        width = scale * GAP + 2.0 * settings.robot_radius
        if clear and is_open(road, [*obstacles, drawn], width):
            obstacles.append(drawn)
    return Scenario((*start, heading), tuple(obstacles))


@by_number
def paper_scenario(_settings: GuidanceSettings, random: Random, most_obstacles: int) -> Scenario:
    """The course of case 3, from starts near the paper's."""
    pose = 0.0, float(random.uniform(*_STARTS)), float(random.uniform(-_ASKEW, _ASKEW))
    return Scenario(pose, _PAPER_OBSTACLES[:most_obstacles])


def is_open(road: Annulus, obstacles: Sequence[Obstacle], width: float) -> bool:
    """True if a disc of this width [m] can drive the whole road.

    It cannot if and only if a chain of obstacles with too narrow gaps joins both edges.
    """
    away = {each: math.dist(each.center, road.center) for each in obstacles}
    if road.outer_radius - road.inner_radius < width:
        return False
    waiting = [each for each in away if away[each] - each.radius - road.inner_radius < width]
    others = [each for each in away if each not in waiting]
    while waiting:
        link = waiting.pop()
        if road.outer_radius - away[link] - link.radius < width:
            return False
        near = [
            each
            for each in others
            if math.dist(link.center, each.center) - link.radius - each.radius < width
        ]
        waiting += near
        others = [each for each in others if each not in near]
    return True


def _point(random: Random, road: Annulus, bearings: tuple[float, float], away: float) -> Point:
    """A point of the road so far from its edges, every square metre as likely as another."""
    bearing = random.uniform(*bearings)
    inner, outer = road.inner_radius + away, road.outer_radius - away
    distance = math.sqrt(random.uniform(inner**2, outer**2))
    x, y = road.center
    return x + distance * math.cos(bearing), y + distance * math.sin(bearing)


# Top speed, wheel speed and weight of the road's centre in case 3 [m/s, rad/s, -].
_TOP_SPEED, _WHEEL_SPEED, _ROAD_CENTER = 1.785, 51.0, 15.0
_THOROUGH: Final = {'solver.iterations_per_step': 4, 'solver.work_share': 0.3}

_RADII_WIDE: Final = 4.0  # width of the ring in radii of the robot, at least
_AHEAD: Final = 2.0  # angle of the ring from start to goal, at most [rad]
_PACE: Final = (0.5, 0.75)  # fraction of the top speed that the shortest way takes


def in_proportion(robot: Robot, given: Mapping[str, Any], radius: float) -> dict[str, Any]:
    """Changes that make case 3 a course for a robot of a radius [m]; weights in proportion."""
    scale = max(robot.max_speed / _TOP_SPEED, _RADII_WIDE * radius / WIDTH)
    unit = float(np.abs(robot.controls(np.array([robot.max_speed, 0.0]))).max()) / _WHEEL_SPEED
    return {
        'road.inner_radius': scale * given['road.inner_radius'],
        'road.outer_radius': scale * given['road.outer_radius'],
        'goal.position': [scale * each for each in given['goal.position']],
        # As modelled, it stops as modelled.
        'safety.stopping_time': 0.0,
        'weights.road_center': _ROAD_CENTER * (unit / scale) ** 2,
        **_THOROUGH,
    }


def robot_scenario(
    settings: GuidanceSettings, seed: int, number: int, most_obstacles: int
) -> Scenario:
    """A scenario with the time that the robot needs; arguments as of `scenario`."""
    x, y = settings.goal
    bearing = math.atan2(y, x)
    made = scenario(settings, seed, number, most_obstacles, (bearing - _AHEAD, bearing + _AHEAD))
    random = np.random.default_rng(np.random.SeedSequence([seed, number, 1]))
    robot, period = settings.robot, settings.control_period
    speed = float(random.uniform(*_PACE)) * robot.max_speed
    way = settings.road.shortest_length(made.pose[:2], settings.goal)
    # Half of the way is lost until a robot that accelerates evenly has its speed.
    time = way / speed + speed / robot.max_acceleration + period
    changes = {'final_time': round(math.ceil(time / period) * period, 6)}
    return replace(made, changes=changes)
