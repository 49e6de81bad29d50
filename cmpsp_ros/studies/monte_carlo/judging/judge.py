"""Whether a failed run was feasible, by an independent solver.

IPOPT, through CasADi, solves the whole horizon at once, for a robot without noise or delay whose
wheels are slowed down by the effects of delay, lag and slip. Only the exact arcs of its controls
count, until it is at rest: they are judged like any other path. If it finds nothing from any start,
that proves nothing.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, Safety
from cmpsp_ros.guidance.planning import along_road, manoeuvres
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.robots import Robot
from cmpsp_ros.studies.common import StudyError
from cmpsp_ros.studies.monte_carlo.driving import farthest
from cmpsp_ros.studies.monte_carlo.judging.grid_search import grid_path
from cmpsp_ros.studies.monte_carlo.judging.slalom import at_constant_speed, slalom
from cmpsp_ros.studies.monte_carlo.study import Task
from cmpsp_ros.studies.paper import Path, reference_solution
from cmpsp_ros.world.roads import Annulus

FEASIBLE: Final = 'feasible'
UNGUARDED: Final = 'feasible, but not between samples by the guard'
NOT_FOUND: Final = 'not found'
OUT_OF_REACH: Final = 'impossible: too far'

NAME: Final = 'judged.json'

_OFFSETS: Final = (0.0, 0.5, -0.5, 0.8, -0.8)
"""Parts of the road's half width beside its centre, where guesses lead [1]."""

_SPARE: Final = (0.15, 0.3, 0.08, 0.02)
"""Beside the margin kept from everything, where guesses lead on other roads [m]."""

_MISS, _ROUNDING, _UNGUARDED_MARGIN = 1e-4, 1e-6, 0.02


def judged(task: Task) -> dict[str, Any]:
    """Solve a run with IPOPT.

    Args:
        task: The run; noise and delay of its plant are ignored.

    Returns:
        `answer`; and, if a path was found, the number of its `start`, its `clearance_m` and
        `miss_m`.

    Raises:
        StudyError: CasADi is not installed.
    """
    pose = np.array(task.scenario.pose)
    way = task.settings.road.shortest_length(task.scenario.pose[:2], task.settings.goal)
    if way > farthest(task):
        return {'answer': OUT_OF_REACH}
    # First what the guidance law keeps to, then samples alone with a little to spare.
    guarded = replace(task.settings, robot=_slowed(task), command_delay=0.0)
    unguarded = replace(guarded, safety=Safety(_UNGUARDED_MARGIN, between_samples=False))
    spaces = ((FEASIBLE, guarded, guarded.safety.margin), (UNGUARDED, unguarded, 0.0))
    for answer, settings, wanted in spaces:
        for place, start in enumerate(_starts(settings, pose)):
            found = reference_solution(settings, pose, start)
            whole = np.vstack([found.controls, found.braking])
            if not np.isfinite(whole).all():
                continue
            miss = _driven(guarded, pose, found.controls).miss
            clearance = float(_driven(guarded, pose, whole).clearance(between_samples=True).min())
            kept = clearance >= wanted - _ROUNDING and found.excess <= _ROUNDING
            if miss <= _MISS and kept:
                return {'answer': answer, 'start': place, 'clearance_m': clearance, 'miss_m': miss}
    return {'answer': NOT_FOUND}


def kept(folder: FilePath, name: str = NAME) -> dict[int, dict[str, Any]]:
    """What was found of runs of a study before, by number.

    Raises:
        StudyError: The file is not one of the judge's.
    """
    path = folder / name
    try:
        if not path.exists():
            return {}
        found = json.loads(path.read_text(encoding='utf-8'))
        return {int(number): dict(each) for number, each in found.items()}
    except (OSError, ValueError, TypeError, AttributeError) as error:
        raise StudyError(f'{path}: {error}') from error


def keep(folder: FilePath, found: Mapping[int, Mapping[str, Any]], name: str = NAME) -> None:
    """Write what was found atomically.

    Raises:
        StudyError: The disk refuses.
    """
    beside = folder / f'{name}.new'
    try:
        beside.write_text(json.dumps(dict(sorted(found.items())), indent=1), encoding='utf-8')
        beside.replace(folder / name)
    except OSError as error:
        raise StudyError(f'{beside}: {error.strerror or error}') from error


def _slowed(task: Task) -> Robot:
    """The robot without what is not modelled; the solver keeps its limits of acceleration."""
    robot = task.settings.robot
    driven = farthest(replace(task, settings=replace(task.settings, robot=_at_once(robot))))
    if not math.isfinite(driven):
        return robot
    fraction = driven / task.settings.final_time / robot.max_speed
    return replace(robot, max_wheel_speed=fraction * robot.max_wheel_speed)


def _at_once(robot: Robot) -> Robot:
    return replace(robot, max_wheel_acceleration=math.inf)


def _starts(settings: GuidanceSettings, pose: Array) -> Iterator[Path]:
    """Where to start from decides on which side obstacles are passed: where most room is, first."""
    if not isinstance(settings.road, Annulus):
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
    within = np.clip(controls, -bounds, bounds)
    durations = np.full(len(within), settings.control_period)
    return Path(settings, settings.robot.roll_out(pose, within, durations), within)
