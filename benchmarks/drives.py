"""Whole runs of the guidance law: presets, the paper's tables, robots that people own, a car."""

from __future__ import annotations

import itertools
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np

from benchmarks.common import BenchError, Spread, collector_off, in_turn
from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.demo import Scenario, load_scenario
from cmpsp_ros.guidance import Decision, GuidanceLaw, GuidanceSettings, Observation, to_nanoseconds
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.planning import Planner, SolveResult
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    guidance_settings,
    load_parameter_file,
)
from cmpsp_ros.parameters.files import preset_names, robot_names, robots_in
from cmpsp_ros.studies.paper import table1, table2


@dataclass(frozen=True)
class Preset:
    """A preset, or a file, that can be driven from a pose ``(3,)`` [m, m, rad]."""

    name: str
    settings: GuidanceSettings
    pose: Array

    @classmethod
    def load(cls, name: str) -> Preset:
        """Read and check a preset or parameter file; of several robots the first."""
        robot = next(iter(robots_in(name)), None)
        values = TABLE.resolve(load_parameter_file(name, namespace=robot))
        check_simulation(values)
        return cls(name, guidance_settings(values), np.array(values['initial_pose']))


def chosen(names: Sequence[str]) -> list[Preset]:
    """Presets of these names; without any, all presets and the runs of the paper's tables.

    From most starts of the latter the first plans need slack.
    """
    if names:
        return [Preset.load(name) for name in names]
    return [*map(Preset.load, preset_names()), *of_tables()]


def of_tables() -> list[Preset]:
    """Case 3 from the guesses and headings of the paper's Tables 1 and 2."""
    return [
        Preset(f'{each.key}, {each.label}', each.settings, np.array(each.pose))
        for each in (*table1(), *table2())
    ]


@dataclass(frozen=True)
class PresetTiming:
    """Times of the first step, with the full horizon, and of every step of a preset [ms]."""

    name: str
    first: Spread
    every: Spread


def time_presets(
    presets: Sequence[Preset], runs: int, progress: Callable[[], None] = lambda: None
) -> list[PresetTiming]:
    """Drive every preset in turn, repeatedly, and take the times.

    The presets are interleaved, so that other work of the machine falls on all of them.
    """
    steps = {preset.name: partial(step_times, preset.settings, preset.pose) for preset in presets}
    # One run that does not count has all compiled code loaded.
    in_turn(steps, 1, lambda: None)
    return [
        PresetTiming(
            name, Spread.of([times[0] for times in runs_of]), Spread.of(np.concatenate(runs_of))
        )
        for name, runs_of in in_turn(steps, runs, progress).items()
    ]


def step_times(settings: GuidanceSettings, pose: Array, *rest: Any) -> Array:
    """Computing time of each control step of one run [ms]; arguments as of `drive`."""
    return np.array([took for took, *_ in drive(settings, pose, *rest)])


def drive(
    settings: GuidanceSettings,
    pose: Array,
    clock: Callable[[], int] = time.perf_counter_ns,
    tracks: Callable[[int], tuple[Track, ...]] = lambda _: (),
) -> Iterator[tuple[float, Decision, Array]]:
    """Drive by the exact model from ``pose (3,)``, commands held for a control period.

    Args:
        settings: Settings of the guidance law.
        pose: Start pose [m, m, rad].
        clock: Clock that times the steps [ns].
        tracks: Moving obstacles at a time [ns].

    Yields:
        Computing time of a control step [ms], its decision, and the resulting pose.
    """
    law, period = GuidanceLaw(settings, settings.world), to_nanoseconds(settings.control_period)
    held = np.array([settings.control_period])
    with collector_off():
        for stamp in itertools.count(0, period):
            seen = tracks(stamp)
            began = clock()
            decision = law.step(Observation(stamp, pose, seen))
            took = (clock() - began) * 1e-6
            if decision is None:
                continue
            if decision.finished:
                break
            pose = settings.robot.roll_out(pose, decision.wheel_speeds[None], held)[-1]
            yield took, decision, pose


COURSE = 'case3_wide'  # the course; its final time is made longer for slow robots


MODELS: Final = 'differential drive', 'car'
# Part of the name of a model whose wheels, and steering, change no faster than they can.
LIMITED: Final = ', limited acceleration'

# As fast as the robot of case 3.
_CAR: Final = (
    'robot.model=ackermann', 'robot.wheel_base=0.2', 'robot.max_steering_angle=0.6',
    'robot.wheel_radius=1.0', 'robot.max_wheel_speed=1.785', 'robot.joint_names=[rear]',
)  # fmt: skip

_LIMITS: Final = (
    ('robot.max_wheel_acceleration=57.0',),
    ('robot.max_wheel_acceleration=2.0', 'robot.max_steering_rate=3.0'),
)


@dataclass(frozen=True)
class RobotDrive:
    """Runs of one robot from start to goal."""

    name: str  # name of the robot
    times: Array  # computing time of every control step, shape ``(runs, N)`` [ms]
    work: IntArray  # visits of a stage in every control step, shape ``(N,)``; they repeat exactly
    levels: dict[str, int]  # steps at each fallback level, by its name
    terminal_error: float  # distance of the robot from the goal at the final time [m]


def robots_that_fit() -> list[str]:
    """Robots of `config/robots` for which the road is wide enough."""
    fit = []
    for name in robot_names():
        with suppress(ParameterError):
            load_scenario(COURSE, (), lockstep=True, robot=name)
            fit.append(name)
    return fit


def of_robots(robots: Sequence[str]) -> dict[str, Scenario]:
    """Courses of robots, by their names or files."""
    return {name: load_scenario(COURSE, (), lockstep=True, robot=name) for name in robots}


def of_models() -> dict[str, Scenario]:
    """Case 3 for its robot and for a car, without and with limits of acceleration."""
    scenarios = {}
    for model, given, limits in zip(MODELS, ((), _CAR), _LIMITS, strict=True):
        for name, more in ((model, ()), (model + LIMITED, limits)):
            changes = 'initial_guess.type=road', *given, *more
            scenarios[name] = load_scenario('case3', changes, lockstep=True)
    return scenarios


def time_robots(
    scenarios: Mapping[str, Scenario], runs: int, progress: Callable[[], None] = lambda: None
) -> list[RobotDrive]:
    """Drive every robot in turn, repeatedly, and take the times."""
    drives = {name: partial(_drive_robot, name, each) for name, each in scenarios.items()}
    found = []
    for name, (first, *others) in in_turn(drives, runs, progress).items():
        if not all(np.array_equal(each.work, first.work) for each in others):
            raise BenchError(f'{name}: found runs that differ, wanted the same work in each')
        times = np.concatenate([each.times for each in (first, *others)])
        found.append(replace(first, times=times))
    return found


def _drive_robot(name: str, scenario: Scenario) -> RobotDrive:
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
