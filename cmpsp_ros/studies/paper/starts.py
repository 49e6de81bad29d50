"""The paper's starts, driven by the guidance law with its own defaults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from rich.table import Table

from cmpsp_ros.guidance import GuidanceSettings, InitialGuess, SolverSettings
from cmpsp_ros.studies.closed_loop import drive
from cmpsp_ros.studies.paper.drives import Path, drive_open
from cmpsp_ros.studies.paper.experiments import cases, table1, table2
from cmpsp_ros.studies.paper.judge import judge

_LIMITS = 51.0, 45.0
_COLUMNS = 'start', 'limit [rad/s]', 'miss [m]', 'clearance [m]', 'cost', "IPOPT's", 'ratio'


@dataclass(frozen=True)
class Started:
    """Result of one start.

    Attributes:
        label: Which guess or heading.
        limit: Of the wheels [rad/s].
        path: The driven path.
        optimum: Cost of IPOPT's path in the same homotopy class; NaN if IPOPT was not run or found
            none.
    """

    label: str
    limit: float
    path: Path
    optimum: float

    @property
    def clearance(self) -> float:
        """Least clearance, between samples too [m]."""
        return float(self.path.clearance(between_samples=True).min())

    @property
    def ratio(self) -> float:
        """Cost over that of IPOPT [1]."""
        return self.path.cost / self.optimum

    def row(self) -> tuple[str, ...]:
        """Its figures, as text."""
        figures = (f'{self.path.cost:.2f}', f'{self.optimum:.2f}', f'{self.ratio:.3f}')
        compared = figures if math.isfinite(self.optimum) else (figures[0], '', '')
        return (
            self.label,
            f'{self.limit:g}',
            f'{self.path.miss:.1e}',
            f'{self.clearance:+.4f}',
            *compared,
        )


def starts() -> list[tuple[str, GuidanceSettings, tuple[float, float, float]]]:
    """All guesses of Table 1, all headings of Table 2, and these along the road, at both limits.

    Returns:
        Of each its label, settings, and the pose that it starts from [m, m, rad].
    """
    return [
        (label, _limited(settings, limit), pose)
        for limit in _LIMITS
        for label, settings, pose in _unlimited()
    ]


def start(
    label: str, settings: GuidanceSettings, pose: tuple[float, float, float], *, compare: bool
) -> Started:
    """Drive from one of the starts.

    Args:
        label: Its label.
        settings: Its settings.
        pose: Its pose [m, m, rad].
        compare: Whether IPOPT computes the optimum in the same homotopy class.

    Raises:
        StudyError: CasADi is not installed.
    """
    at = np.array(pose)
    decisions = list(drive(settings, at))[:-1]
    path = drive_open(settings, at, np.array([each.wheel_speeds for each in decisions]))
    optimum = math.nan
    if compare:
        found = judge(settings, at, path)
        optimum = found.cost if found.feasible else math.nan
    return Started(label, settings.robot.max_wheel_speed, path, optimum)


def run(progress: Callable[[str, int], None], *, compare: bool) -> Table:
    """Drive from all of them.

    Args:
        progress: Called with the label of each, and their number.
        compare: Whether IPOPT is asked as well.

    Raises:
        StudyError: CasADi is not installed.
    """
    table = Table(*_COLUMNS)
    given = starts()
    for label, settings, pose in given:
        progress(label, len(given))
        table.add_row(*start(label, settings, pose, compare=compare).row())
    return table


def _unlimited() -> Iterator[tuple[str, GuidanceSettings, tuple[float, float, float]]]:
    case3 = replace(cases()[-1], label="Case 3, the paper's guess")
    road = InitialGuess('road')
    for each in (case3, *table1(), *table2()):
        yield each.label, each.settings, each.pose
    for each in table2():
        yield f'{each.label}, road guess', replace(each.settings, initial_guess=road), each.pose


def _limited(settings: GuidanceSettings, limit: float) -> GuidanceSettings:
    robot = replace(settings.robot, max_wheel_speed=limit)
    return replace(settings, robot=robot, solver=SolverSettings())
