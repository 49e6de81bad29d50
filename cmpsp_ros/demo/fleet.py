"""Several robots: each with its own simulator and guidance, all in one bag."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np

from cmpsp_ros.bags.runs import Run, longest_interval, pieces, read_run, robot_encounters
from cmpsp_ros.demo.results import draw_fleet
from cmpsp_ros.demo.runner import driven
from cmpsp_ros.demo.scenario import Scenario, load_scenario
from cmpsp_ros.demo.summary import Summary, summarise, window
from cmpsp_ros.parameters import ParameterError, Problem
from cmpsp_ros.parameters.files import write_fleet_file
from cmpsp_ros.robots import placed


@dataclass(frozen=True)
class RobotOutcome:
    """Result of the run of one robot of several.

    `apart` is the least distance from any other until its final time, also between samples [m].
    """

    namespace: str
    summary: Summary
    apart: float

    @property
    def has_failed(self) -> bool:
        """True if it failed for certain."""
        return self.summary.has_failed or self.apart < 0.0

    @property
    def failure(self) -> str:
        """Why its run failed, in words; empty if it did not."""
        touched = f'it touched another by {-self.apart:.3g} m' if self.apart < 0.0 else ''
        return ' and '.join(filter(None, [self.summary.failure, touched]))


def load_fleet(
    preset: str,
    namespaces: Sequence[str],
    assignments: Sequence[str],
    *,
    lockstep: bool = False,
    robot: str | None = None,
) -> tuple[Scenario, ...]:
    """Load the scenario of each robot in a file, as from `load_scenario`, and check the whole.

    Raises:
        ParameterError: A key or value is wrong, robots start too close to each other, or simulated
            time is requested, which several simulators do not share.
    """
    fleet = tuple(
        load_scenario(preset, assignments, lockstep=lockstep, robot=robot, namespace=each)
        for each in namespaces
    )
    problems = [
        Problem(f'{each.namespace}: {key}', 'true', 'false: several simulators share no clock')
        for each in fleet
        for key in ('lockstep', 'publish_clock')
        if each.values[key]
    ]
    for one, other in combinations(fleet, 2):
        (x, y), pose = other.values['initial_pose'][:2], np.array(one.values['initial_pose'])
        discs = placed(one.settings.footprint.discs, pose)
        away = float(np.hypot(*(discs - (x, y)).T).min())
        least = one.settings.robot_radius + other.settings.circumscribed_radius
        if away < least:
            found, wanted = f'{away:.3g} m from {other.namespace}', f'{least:.3g} m or more'
            problems.append(Problem(f'{one.namespace}: initial_pose', found, wanted))
    if problems:
        raise ParameterError(*problems)
    return fleet


def run_fleet(
    fleet: Sequence[Scenario],
    folder: Path,
    progress: Callable[[float], None],
    view_port: int | None = None,
) -> tuple[RobotOutcome, ...]:
    """`run` for several robots at once; the page shows the first of them."""
    write_fleet_file(folder / 'parameters.yaml', {each.namespace: each.values for each in fleet})
    with driven(fleet, folder, progress, view_port):
        return _sum_up(fleet, folder)


def _sum_up(fleet: Sequence[Scenario], folder: Path) -> tuple[RobotOutcome, ...]:
    runs = [read_run(folder / 'bag', each.namespace) for each in fleet]
    robots = tuple(_robot(each, run, fleet, runs) for each, run in zip(fleet, runs, strict=True))
    values = {each.namespace: each.summary.values() | {'apart_m': each.apart} for each in robots}
    text = json.dumps({'preset': fleet[0].name, 'robots': values}, indent=2)
    (folder / 'summary.json').write_text(f'{text}\n', encoding='utf-8')
    draw_fleet(fleet, runs, folder / 'trajectory.png')
    return robots


def _robot(own: Scenario, run: Run, fleet: Sequence[Scenario], runs: Sequence[Run]) -> RobotOutcome:
    first, last = window(run, own.settings)
    longest, apart = longest_interval(run.driven.stamps, own.settings), math.inf
    paths = list(pieces(run.driven, first, last, longest))
    for other, its in zip(fleet, runs, strict=True):
        if other is not own:
            timeout = own.settings.moving_obstacles.timeout
            around = other.settings.circumscribed_radius, own.settings.bodies, timeout
            for path in paths:
                met = robot_encounters(path, {other.namespace: its.driven}, *around)
                apart = min([apart, *(float(each.clearance.min()) for each in met)])
    return RobotOutcome(own.namespace, summarise(run, own.settings, own.name), apart)
