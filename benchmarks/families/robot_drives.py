"""Robots that people own on `case3_wide`, and a car on `case3`: whole runs, driven in lockstep."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.families.presets import drive
from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.demo import Scenario, load_scenario
from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.planning import Planner, SolveResult
from cmpsp_ros.parameters import ParameterError
from cmpsp_ros.parameters.files import robot_names

PRESET = 'case3_wide'
"""The course; its final time is made longer for slow robots."""


MODELS: Final = 'differential drive', 'car'
LIMITED: Final = ', limited acceleration'
"""What is in the name of a model whose wheels, and steering, change no faster than they can."""

_CAR: Final = (
    'robot.model=ackermann', 'robot.wheel_base=0.2', 'robot.max_steering_angle=0.6',
    'robot.wheel_radius=1.0', 'robot.max_wheel_speed=1.785', 'robot.joint_names=[rear]',
)  # fmt: skip
"""As fast as the robot of case 3."""

_LIMITS: Final = (
    ('robot.max_wheel_acceleration=57.0',),
    ('robot.max_wheel_acceleration=2.0', 'robot.max_steering_rate=3.0'),
)


@dataclass(frozen=True)
class RobotDrive:
    """Runs of one robot from start to goal.

    Attributes:
        name: Of the robot.
        times: Computing time of every control step, shape ``(runs, N)`` [ms].
        work: Visits of a stage in every control step, shape ``(N,)``; they repeat exactly.
        levels: Steps at each fallback level, by its name.
        terminal_error: Distance of the robot from the goal at the final time [m].
    """

    name: str
    times: Array
    work: IntArray
    levels: dict[str, int]
    terminal_error: float


def robots_that_fit() -> list[str]:
    """Robots of `config/robots` for which the road is wide enough."""
    fit = []
    for name in robot_names():
        with suppress(ParameterError):
            load_scenario(PRESET, (), lockstep=True, robot=name)
            fit.append(name)
    return fit


def of_robots(robots: Sequence[str]) -> dict[str, Scenario]:
    """Courses of robots, by their names or files.

    Raises:
        ParameterError: No such robot, or one that cannot drive there.
    """
    return {name: load_scenario(PRESET, (), lockstep=True, robot=name) for name in robots}


def of_models() -> dict[str, Scenario]:
    """Case 3 for its robot and for a car, without and with limits of acceleration."""
    scenarios = {}
    for model, given, limits in zip(MODELS, ((), _CAR), _LIMITS, strict=True):
        for name, more in ((model, ()), (model + LIMITED, limits)):
            changes = 'initial_guess.type=road', *given, *more
            scenarios[name] = load_scenario('case3', changes, lockstep=True)
    return scenarios


def measure(
    scenarios: Mapping[str, Scenario], runs: int, progress: Callable[[], None] = lambda: None
) -> list[RobotDrive]:
    """Drive every robot in turn, again and again, and take the times.

    Raises:
        BenchError: Two runs of one robot differ.
    """
    drives: dict[str, RobotDrive] = {}
    for _ in range(runs):
        for name, scenario in scenarios.items():
            drive = _drive(name, scenario)
            known = drives.setdefault(name, drive)
            if not np.array_equal(drive.work, known.work):
                raise BenchError(f'{name}: found runs that differ, wanted the same work in each')
            if drive is not known:
                drives[name] = replace(known, times=np.concatenate([known.times, drive.times]))
            progress()
    return list(drives.values())


def _drive(name: str, scenario: Scenario) -> RobotDrive:
    """One run by the exact model, commands held for a control period."""
    settings, pose = scenario.settings, np.array(scenario.values['initial_pose'], float)
    # One step that does not count has compiled code loaded.
    GuidanceLaw(settings, settings.world).step(Observation(0, pose))
    times, work, levels = [], [], Counter[str]()
    with _counted_work() as counted:
        for took, decision, reached in drive(settings, pose, time.thread_time_ns):
            times.append(took)
            work.append(sum(counted))
            counted.clear()
            levels[decision.level.name.lower()] += 1
            pose = reached
    miss, _ = settings.target.errors(pose)
    return RobotDrive(name, np.array([times]), np.array(work), dict(levels), miss)


@contextmanager
def _counted_work() -> Iterator[list[int]]:
    """The work of every plan that is improved from now on."""
    counted: list[int] = []
    improve = Planner.improve

    def counting(planner: Planner, *args: Any, **options: Any) -> SolveResult:
        improvement = improve(planner, *args, **options)
        counted.append(improvement.work)
        return improvement

    Planner.improve = counting  # type: ignore[method-assign, assignment]
    try:
        yield counted
    finally:
        Planner.improve = improve  # type: ignore[method-assign]
