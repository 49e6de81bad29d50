"""Several robots, each with its own simulator and guidance: their scenarios, and how near."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from cmpsp_ros.bags.runs import Run, longest_interval, pieces, robot_encounters
from cmpsp_ros.demo.scenario import Scenario, load_scenario
from cmpsp_ros.demo.summary import window
from cmpsp_ros.parameters import ParameterError, Problem
from cmpsp_ros.robots import placed


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


def nearest_robot(number: int, fleet: Sequence[Scenario], runs: Sequence[Run]) -> float:
    """Least distance of a robot from any other until its final time, also between samples [m]."""
    own, run, apart = fleet[number], runs[number], math.inf
    first, last = window(run, own.settings)
    longest = longest_interval(run.driven.stamps, own.settings)
    for path in pieces(run.driven, first, last, longest):
        for other, its in zip(fleet, runs, strict=True):
            others = {} if other is own else {other.namespace: its.driven}
            timeout = own.settings.moving_obstacles.timeout
            around = other.settings.circumscribed_radius, own.settings.bodies, timeout
            for each in robot_encounters(path, others, *around):
                apart = min(apart, float(each.clearance.min()))
    return apart
