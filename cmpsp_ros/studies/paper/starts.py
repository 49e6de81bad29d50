"""The paper's starts, driven by the guidance law with its own defaults."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from rich.table import Table

from cmpsp_ros.guidance import GuidanceSettings, InitialGuess, SolverSettings
from cmpsp_ros.studies.closed_loop import drive
from cmpsp_ros.studies.paper.drives import Path
from cmpsp_ros.studies.paper.experiments import cases, table1, table2
from cmpsp_ros.studies.paper.ipopt import reference_solution

_LIMITS = 51.0, 45.0
_COLUMNS = 'start', 'limit [rad/s]', 'miss [m]', 'clearance [m]', 'cost', "IPOPT's", 'ratio'


class Start(NamedTuple):
    """Label, settings and initial pose [m, m, rad] of a start."""

    label: str
    settings: GuidanceSettings
    pose: tuple[float, float, float]


class StartOutcome(NamedTuple):
    """Result of one start.

    Attributes:
        path: The driven path.
        optimum: Cost of IPOPT's path in the same homotopy class; NaN if IPOPT was not run or found
            none.
    """

    path: Path
    optimum: float

    @property
    def clearance(self) -> float:
        """Minimum clearance, between samples too [m]."""
        return float(self.path.clearance(between_samples=True).min())

    @property
    def ratio(self) -> float:
        """Cost over that of IPOPT [1]."""
        return self.path.cost / self.optimum


def starts() -> list[Start]:
    """All guesses of Table 1, all headings of Table 2, and these along the road, at both limits."""
    case3 = replace(cases()[-1], label="Case 3, the paper's guess")
    given = [Start(each.label, each.settings, each.pose) for each in (case3, *table1(), *table2())]
    for each in table2():
        settings = replace(each.settings, initial_guess=InitialGuess('road'))
        given.append(Start(f'{each.label}, road guess', settings, each.pose))
    return [
        each._replace(
            settings=replace(
                each.settings,
                robot=replace(each.settings.robot, max_wheel_speed=limit),
                solver=SolverSettings(),
            )
        )
        for limit in _LIMITS
        for each in given
    ]


def drive_start(start: Start, *, compare: bool) -> StartOutcome:
    """Drive from one of the starts.

    Args:
        start: The start.
        compare: True if IPOPT computes the optimum in the same homotopy class.

    Raises:
        StudyError: CasADi is not installed.
    """
    settings, pose = start.settings, np.array(start.pose)
    decisions = list(drive(settings, pose))[:-1]
    path = Path.open_loop(settings, pose, np.array([each.wheel_speeds for each in decisions]))
    optimum = math.nan
    if compare:
        found = reference_solution(settings, pose, path)
        optimum = found.cost if found.feasible else math.nan
    return StartOutcome(path, optimum)


def run_starts(progress: Callable[[str, int], None], *, compare: bool) -> Table:
    """Drive from all starts.

    Args:
        progress: Called with the label of each, and their number.
        compare: True to run IPOPT as well.

    Raises:
        StudyError: CasADi is not installed.
    """
    table = Table(*_COLUMNS)
    given = starts()
    for each in given:
        progress(each.label, len(given))
        found = drive_start(each, compare=compare)
        figures = (f'{found.path.cost:.2f}', f'{found.optimum:.2f}', f'{found.ratio:.3f}')
        table.add_row(
            each.label,
            f'{each.settings.robot.max_wheel_speed:g}',
            f'{found.path.miss:.1e}',
            f'{found.clearance:+.4f}',
            *(figures if math.isfinite(found.optimum) else (figures[0], '', '')),
        )
    return table
