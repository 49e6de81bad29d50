"""Tasks for the robot, drawn at random around the presets and the paper's runs."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.verify.case import Rng
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, InitialGuess
from cmpsp_ros.parameters import TABLE, config_directory, guidance_settings, load_parameter_file
from cmpsp_ros.world.obstacles import Obstacle

# By name: another preset must not make other programs of the same seeds.
_PRESETS: Final = ('case1', 'case2', 'case3', 'case3_45')
_WHEEL_LIMITS: Final = (math.inf, 45.0, 48.0, 51.0, 55.0, 60.0)
_HORIZONS: Final = ((0.55, 1, 30), (0.35, 30, 60), (0.1, 60, 200))


@dataclass(frozen=True)
class RobotScenario:
    """A task and the pose of the robot."""

    name: str  # description
    settings: GuidanceSettings  # the task
    pose: Array  # pose of the robot, shape ``(3,)`` [m, m, rad]


Maker = Callable[[Rng], RobotScenario]


def ordinary(rng: Rng) -> RobotScenario:
    """A preset or a run of the paper, mostly with changes."""
    presets, paper = _bases()
    bases = presets if rng.random() < 0.75 else paper
    base = bases[rng.integers(len(bases))]
    settings, pose = base.settings, base.pose
    if rng.random() < 0.5:
        limit = _WHEEL_LIMITS[rng.integers(len(_WHEEL_LIMITS))]
        settings = replace(settings, robot=replace(settings.robot, max_wheel_speed=limit))
    if rng.random() < 0.35:
        settings = replace(settings, obstacles=_field(rng, settings, int(rng.integers(7))))
    if rng.random() < 0.4:
        settings, pose = _elsewhere(rng, settings, pose)
    if rng.random() < 0.3:
        pose = pose + np.array([0.15, 0.15, 0.5]) * rng.normal(size=3)
    return RobotScenario(base.name, _varied(rng, _with_horizon(settings, draw_horizon(rng))), pose)


def crowded(rng: Rng) -> RobotScenario:
    """Wheels hardly fast enough, a road hardly wide enough, a long horizon: many active rows."""
    base = ordinary(rng)
    settings, road = base.settings, base.settings.world.annulus
    middle = road.center_radius
    bearing, half = rng.uniform(-2.2, -0.8), 10.0 ** rng.uniform(-2.0, -0.3)
    radius = middle + rng.uniform(-0.9, 0.9) * half
    heading = bearing + 0.5 * math.pi + 0.1 * half * rng.normal()
    pose = np.array([radius * math.cos(bearing), radius * math.sin(bearing), heading])
    pace = rng.uniform(0.8, 1.7)
    # Without the pull to the middle and with a price on speed the way leads along the inner edge.
    weights = replace(
        settings.weights,
        road_center=float(rng.choice([0.01, 15.0])),
        control_effort=float(rng.choice([0.0, 1.0])),
    )
    settings = replace(
        settings,
        final_time=_arc(settings, pose) / pace,
        road=replace(road, inner_radius=middle - half, outer_radius=middle + half),
        # A narrow road leaves no gap beside an obstacle.
        obstacles=(),
        weights=weights,
        safety=replace(settings.safety, between_samples=bool(rng.random() < 0.2)),
        initial_guess=InitialGuess('road'),
    )
    if rng.random() < 0.7:
        limit = rng.uniform(1.0, 1.05) * pace / settings.robot.wheel_radius
        settings = replace(settings, robot=replace(settings.robot, max_wheel_speed=limit))
    horizon = int(rng.integers(30, 120)) if rng.random() < 0.85 else int(rng.integers(120, 201))
    return RobotScenario(f'crowded {base.name}', _with_horizon(settings, horizon), pose)


def blocked(rng: Rng) -> RobotScenario:
    """A goal out of reach, an obstacle across the road, or both."""
    base = ordinary(rng)
    settings = base.settings
    kind = rng.integers(3)
    walled, out_of_reach = kind != 0, kind != 1
    if walled:
        bearing = rng.uniform(-1.2, -0.3)
        radius = settings.world.annulus.center_radius
        center = radius * math.cos(bearing), radius * math.sin(bearing)
        wall = Obstacle('wall', center, rng.uniform(1.0, 2.0))
        settings = replace(settings, obstacles=(*settings.obstacles, wall))
    if out_of_reach:
        enough = _arc(settings, base.pose) / settings.final_time / settings.robot.wheel_radius
        robot = replace(settings.robot, max_wheel_speed=max(1.0, rng.uniform(0.3, 0.95) * enough))
        settings = replace(settings, robot=robot)
    return RobotScenario(f'blocked {base.name}', settings, base.pose)


def tangent(rng: Rng) -> RobotScenario:
    """Obstacles that touch the road's edges from either side, or one another, exactly."""
    base = ordinary(rng)
    road = base.settings.world.annulus
    obstacles = []
    for index in range(int(rng.integers(1, 4))):
        radius = float(rng.choice([0.25, 0.5, 1.0]))
        edge = (road.outer_radius, road.inner_radius)[rng.integers(2)]
        away = edge + float(rng.choice([-1.0, 1.0])) * radius
        bearing = rng.choice([0.0, -0.5 * math.pi, rng.uniform(-1.4, -0.1)])
        center = away * math.cos(bearing), away * math.sin(bearing)
        obstacles.append(Obstacle(f'touching {index}', center, radius))
    if rng.random() < 0.5:
        obstacles.append(replace(obstacles[0], name='the same again'))
    safety = replace(base.settings.safety, between_samples=False)
    settings = replace(base.settings, obstacles=tuple(obstacles), safety=safety)
    return RobotScenario(f'tangent {base.name}', settings, base.pose)


def flat(rng: Rng) -> RobotScenario:
    """Control weights that all but vanish beside that of the road."""
    base = ordinary(rng)
    scale = base.settings.weights.road_center * 10.0 ** rng.uniform(-10.0, -6.0)
    effort = scale if rng.random() < 0.5 else 0.0
    weights = replace(base.settings.weights, control_change=scale, control_effort=effort)
    return RobotScenario(f'flat {base.name}', replace(base.settings, weights=weights), base.pose)


def draw_horizon(rng: Rng) -> int:
    """Steps of a horizon: 55 % up to 30, 35 % up to 60, 10 % up to 200."""
    chosen = rng.random()
    for share, least, most in _HORIZONS:
        if chosen < share:
            return int(rng.integers(least, most + 1))
        chosen -= share
    return _HORIZONS[-1][2]


@cache
def _bases() -> tuple[tuple[RobotScenario, ...], tuple[RobotScenario, ...]]:
    """The presets, and the paper's obstacle fields."""
    config = config_directory()
    presets = tuple(_base(config / f'{name}.yaml') for name in _PRESETS)
    return presets, tuple(_base(path) for path in sorted((config / 'paper').glob('*.yaml')))


def _base(path: Path) -> RobotScenario:
    values = TABLE.resolve(load_parameter_file(path))
    return RobotScenario(path.stem, guidance_settings(values), np.array(values['initial_pose']))


def _with_horizon(settings: GuidanceSettings, steps: int) -> GuidanceSettings:
    return replace(settings, control_period=settings.final_time / steps)


def _elsewhere(rng: Rng, settings: GuidanceSettings, pose: Array) -> tuple[GuidanceSettings, Array]:
    """Another start along the road, another time to the goal, another first guess."""
    if rng.random() < 0.5:
        bearing = rng.uniform(-2.5, -0.3)
        radius = settings.world.annulus.center_radius + rng.uniform(-0.9, 0.9)
        heading = bearing + 0.5 * math.pi + 0.4 * rng.normal()
        if rng.random() < 0.15:
            heading = rng.uniform(-math.pi, math.pi)
        pose = np.array([radius * math.cos(bearing), radius * math.sin(bearing), heading])
    pace = rng.uniform(0.6, 1.02) * min(settings.robot.max_speed, 2.5)
    settings = replace(settings, final_time=max(0.5, _arc(settings, pose) / pace))
    guess = InitialGuess('road')
    if rng.random() < 0.5:
        right = rng.uniform(10.0, 55.0)
        spread = 15.0 if rng.random() < 0.2 else 1.0
        guess = InitialGuess('constant', (right, right + spread * rng.normal()))
    return replace(settings, initial_guess=guess), pose


def _varied(rng: Rng, settings: GuidanceSettings) -> GuidanceSettings:
    """Other weights, Hessians and trust regions now and then."""
    weights, solver, safety = settings.weights, settings.solver, settings.safety
    if rng.random() < 0.2:
        weights = replace(weights, control_effort=10.0 ** rng.uniform(-4.0, 0.0))
    if rng.random() < 0.15:
        weights = replace(weights, control_rate=10.0 ** rng.uniform(-3.0, 1.0))
    if rng.random() < 0.2:
        solver = replace(solver, hessian='projected')
    if rng.random() < 0.3:
        solver = replace(solver, heading_trust_region=0.0)
    # Between samples that are far apart no path is known to be clear.
    if rng.random() < 0.3 or settings.control_period > 0.4:
        safety = replace(safety, between_samples=False)
    return replace(settings, weights=weights, solver=solver, safety=safety)


def _field(rng: Rng, settings: GuidanceSettings, count: int) -> tuple[Obstacle, ...]:
    """Obstacles on and beside the road, between a quarter turn and the goal."""
    obstacles = []
    for index in range(count):
        bearing = rng.uniform(-1.4, -0.1)
        away = settings.world.annulus.center_radius + rng.uniform(-1.3, 1.3)
        center = away * math.cos(bearing), away * math.sin(bearing)
        obstacles.append(Obstacle(f'random {index}', center, rng.uniform(0.1, 0.7)))
    return tuple(obstacles)


def _arc(settings: GuidanceSettings, pose: Array) -> float:
    """Way along the centre line to the goal [m]."""
    bearing = math.atan2(pose[1], pose[0])
    goal = math.atan2(settings.goal[1], settings.goal[0])
    return settings.world.annulus.center_radius * abs(math.remainder(goal - bearing, math.tau))
