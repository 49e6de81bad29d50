"""The paper's starts, driven by the guidance law with its own defaults."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from rich.table import Table

from cmpsp_ros.guidance import InitialGuess, SolverSettings
from cmpsp_ros.studies.closed_loop import drive
from cmpsp_ros.studies.paper.drives import Path
from cmpsp_ros.studies.paper.experiments import Experiment, cases, table1, table2
from cmpsp_ros.studies.paper.ipopt import reference_solution

_LIMITS = 51.0, 45.0
_COLUMNS = 'start', 'limit [rad/s]', 'miss [m]', 'clearance [m]', 'cost', "IPOPT's", 'ratio'


def starts() -> list[Experiment]:
    """All guesses of Table 1, all headings of Table 2, and these along the road, at both limits."""
    along_road = [
        replace(
            each,
            label=f'{each.label}, road guess',
            settings=replace(each.settings, initial_guess=InitialGuess('road')),
        )
        for each in table2()
    ]
    case3 = replace(cases()[-1], label="Case 3, the paper's guess")
    return [
        replace(
            each,
            settings=replace(
                each.settings,
                robot=replace(each.settings.robot, max_wheel_speed=limit),
                solver=SolverSettings(),
            ),
        )
        for limit in _LIMITS
        for each in (case3, *table1(), *table2(), *along_road)
    ]


def drive_start(start: Experiment, *, compare: bool) -> tuple[Path, float]:
    """Driven path and, to `compare`, IPOPT's least cost in its homotopy class; NaN if not found."""
    settings, pose = start.settings, np.array(start.pose)
    decisions = list(drive(settings, pose))[:-1]
    path = Path.open_loop(settings, pose, np.array([each.wheel_speeds for each in decisions]))
    if not compare:
        return path, math.nan
    found = reference_solution(settings, pose, path)
    return path, found.cost if found.feasible else math.nan


def run_starts(progress: Callable[[str, int], None], *, compare: bool) -> Table:
    """Drive from all starts; `progress` is called with the label of each, and their number."""
    table, given = Table(*_COLUMNS), starts()
    for each in given:
        progress(each.label, len(given))
        path, optimum = drive_start(each, compare=compare)
        table.add_row(
            each.label,
            f'{each.settings.robot.max_wheel_speed:g}',
            f'{path.miss:.1e}',
            f'{path.clearance(between_samples=True).min():+.4f}',
            f'{path.cost:.2f}',
            *([f'{optimum:.2f}', f'{path.cost / optimum:.3f}'] if optimum > 0.0 else []),
        )
    return table
