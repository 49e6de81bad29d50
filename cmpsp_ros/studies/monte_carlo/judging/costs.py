"""What a run costs, beside the least cost that IPOPT finds in its homotopy class."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.studies.monte_carlo.driving import drive
from cmpsp_ros.studies.monte_carlo.study import Task
from cmpsp_ros.studies.paper import Path, reference_solution

NAME: Final = 'costs.json'

WITHIN: Final = 0.05
"""Part of the least cost that a run may cost more."""


def compared(task: Task) -> dict[str, Any]:
    """Solve a run that arrived with IPOPT, from the path driven.

    Args:
        task: The run, of a robot as modelled.

    Returns:
        `cost` of the run; and, if IPOPT solved it, its `least` cost and whether its path is of the
        `same_class`.

    Raises:
        StudyError: CasADi is not installed.
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
    """Whether two paths with the same ends pass a point on the same side.

    Args:
        one: Positions ``(N, 2)`` or poses [m].
        other: See `one`.
        center: The point, shape ``(2,)`` [m].
    """
    return abs(_swept(one, center) - _swept(other, center)) < math.pi


def _swept(path: Array, center: Array) -> float:
    """Angle by which the direction from a point to a path turns along it [rad]."""
    away = path[:, :2] - center
    bearings = np.unwrap(np.arctan2(away[:, 1], away[:, 0]))
    return float(bearings[-1] - bearings[0])
