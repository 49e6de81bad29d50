"""Independent judgement of runs by IPOPT: feasibility of failed ones, and costs of others.

IPOPT solves the whole horizon at once, for a robot without noise or delay whose wheels are slowed
down by the effects of delay, lag and slip. Only the exact arcs of its controls count, until it is
at rest: they are judged like any other path. If it finds nothing from any start, that proves
nothing.
"""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings, Safety
from cmpsp_ros.guidance.planning import along_road, manoeuvres
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.robots import Robot
from cmpsp_ros.studies.common import StudyError, disk_errors
from cmpsp_ros.studies.monte_carlo.driving import drive, farthest
from cmpsp_ros.studies.monte_carlo.guesses import at_constant_speed, grid_path, slalom
from cmpsp_ros.studies.monte_carlo.study import RunTask
from cmpsp_ros.studies.paper import Path, reference_solution
from cmpsp_ros.world.roads import Annulus

FEASIBLE: Final = 'feasible'
UNGUARDED: Final = 'feasible, but not between samples by the guard'
NOT_FOUND: Final = 'not found'
OUT_OF_REACH: Final = 'impossible: too far'

JUDGED: Final = 'judged.json'
COSTS: Final = 'costs.json'

# Offsets of guesses from the road's centre, by its half width [1].
_OFFSETS: Final = (0.0, 0.5, -0.5, 0.8, -0.8)

# Clearance of guesses on other roads, beside the margin [m].
_SPARE: Final = (0.15, 0.3, 0.08, 0.02)

_MISS, _ROUNDING, _UNGUARDED_MARGIN = 1e-4, 1e-6, 0.02


def judge_failure(task: RunTask) -> dict[str, Any]:
    """Solve a failed run with IPOPT; noise and delay of its plant are ignored.

    Returns:
        `answer`; and, if a path was found, the number of its `start`, its `clearance_m` and
        `miss_m`.
    """
    pose = np.array(task.scenario.pose)
    length = task.settings.road.shortest_length(task.scenario.pose[:2], task.settings.goal)
    if length > farthest(task):
        return {'answer': OUT_OF_REACH}
    # First with the constraints of the guidance law, then samples alone with a little to spare.
    guarded = replace(task.settings, robot=_slowed(task), command_delay=0.0)
    unguarded = replace(guarded, safety=Safety(_UNGUARDED_MARGIN, between_samples=False))
    spaces = ((FEASIBLE, guarded, guarded.safety.margin), (UNGUARDED, unguarded, 0.0))
    for answer, settings, wanted in spaces:
        for number, start in enumerate(_starts(settings, pose)):
            found = reference_solution(settings, pose, start)
            whole = np.vstack([found.controls, found.braking])
            if not np.isfinite(whole).all():
                continue
            miss = _driven(guarded, pose, found.controls).miss
            clearance = float(_driven(guarded, pose, whole).clearance(between_samples=True).min())
            kept = clearance >= wanted - _ROUNDING and found.excess <= _ROUNDING
            if miss <= _MISS and kept:
                return {'answer': answer, 'start': number, 'clearance_m': clearance, 'miss_m': miss}
    return {'answer': NOT_FOUND}


def compare_cost(task: RunTask) -> dict[str, Any]:
    """Solve a run that arrived, of a robot as modelled, with IPOPT from the path driven.

    Returns:
        `cost` of the run; and, if IPOPT solved it, its `least` cost and whether its path is of the
        `same_class`.
    """
    settings, driven = task.settings, drive(task)
    steps = round(settings.final_time / settings.control_period)
    stamps = np.arange(steps + 1) * round(settings.control_period * NANOSECONDS)
    poses = np.array([driven.at(stamp) for stamp in stamps.tolist()])
    path = Path(settings, poses, driven.controls[:steps])
    found = reference_solution(settings, poses[0], path)
    if not found.feasible:
        return {'cost': path.cost}
    others = settings.robot.roll_out(poses[0], found.controls, path.durations)
    centers = [np.array(each.center) for each in task.scenario.obstacles]
    alike = all(passed_alike(poses, others, each) for each in centers)
    return {'cost': path.cost, 'least': found.cost, 'same_class': alike}


def passed_alike(one: Array, other: Array, center: Array) -> bool:
    """True if two paths with the same ends pass a point on the same side.

    Paths are positions ``(N, 2)`` or poses [m], the point has shape ``(2,)`` [m].
    """
    return abs(_swept_angle(one, center) - _swept_angle(other, center)) < math.pi


def read_answers(path: FilePath) -> dict[int, dict[str, Any]]:
    """Answers on runs of a study found before, by number."""
    try:
        if not path.exists():
            return {}
        found = json.loads(path.read_text(encoding='utf-8'))
        return {int(number): dict(each) for number, each in found.items()}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise StudyError(f'{path}: {error}') from error


def write_answers(path: FilePath, found: Mapping[int, Mapping[str, Any]]) -> None:
    """Write answers atomically."""
    beside = path.with_name(f'{path.name}.new')
    with disk_errors(beside):
        beside.write_text(json.dumps(dict(sorted(found.items())), indent=1), encoding='utf-8')
        beside.replace(path)


def _swept_angle(path: Array, center: Array) -> float:
    """Angle by which the direction from a point to a path turns along it [rad]."""
    away = path[:, :2] - center
    bearings = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return float(bearings[-1] - bearings[0])


def _slowed(task: RunTask) -> Robot:
    """The robot slowed down by unmodelled effects; the solver keeps its limits of acceleration."""
    robot = task.settings.robot
    at_once = replace(robot, max_wheel_acceleration=math.inf)
    driven = farthest(replace(task, settings=replace(task.settings, robot=at_once)))
    if not math.isfinite(driven):
        return robot
    fraction = driven / task.settings.final_time / robot.max_speed
    return replace(robot, max_wheel_speed=fraction * robot.max_wheel_speed)


def _starts(settings: GuidanceSettings, pose: Array) -> Iterator[Path]:
    """Paths to start from, which decide on which side obstacles are passed: widest gaps first."""
    if not isinstance(settings.world.road, Annulus):
        for spare in _SPARE:
            points = grid_path(settings, pose, spare)
            if len(points):
                yield at_constant_speed(settings, pose, points)
        return
    road = settings.world.annulus
    half = (road.outer_radius - road.inner_radius) / 2.0
    steps = round(settings.final_time / settings.control_period)
    durations = np.full(steps, settings.control_period)
    yield slalom(settings, pose)
    for offset in _OFFSETS:
        shifted = replace(
            road,
            inner_radius=road.inner_radius + offset * half,
            outer_radius=road.outer_radius + offset * half,
        )
        start = PlanStart(pose, settings.robot, replace(settings.world, road=shifted))
        controls = along_road(settings, start, settings.target, durations)
        yield _driven(settings, pose, controls[:-1])
    if not settings.robot.turns_on_the_spot:
        start = PlanStart(pose, settings.robot, settings.world)
        for controls in manoeuvres(settings, start, settings.target, durations):
            yield _driven(settings, pose, controls[:-1])


def _driven(settings: GuidanceSettings, pose: Array, controls: Array) -> Path:
    bounds = settings.robot.bounds
    return Path.open_loop(settings, pose, np.clip(controls, -bounds, bounds))
