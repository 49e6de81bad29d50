"""Computing time over the number of steps."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.common import BenchError, collector_off, timed, unheard
from benchmarks.drives import Preset
from benchmarks.methods.ours import Method
from benchmarks.methods.peers import peers
from benchmarks.task import Task
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import remaining, to_nanoseconds
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import Planner, PlanningContext

HORIZONS = (10, 25, 50, 100, 200, 400)

# Steps from which on the growth is fitted: below, what does not grow counts too much.
_ASYMPTOTIC = 100


@dataclass(frozen=True)
class Growth:
    """Medians of a first step over horizons [us], and their exponent from 100 steps on."""

    name: str
    steps: list[int]
    times: list[float]
    exponent: float | None

    @classmethod
    def of(cls, name: str, times: dict[int, float]) -> Growth:
        """From the times by number of steps."""
        long = {steps: each for steps, each in times.items() if steps >= _ASYMPTOTIC}
        return cls(name, list(times), list(times.values()), exponent(long))


def exponent(times: dict[int, float]) -> float | None:
    """Slope of the logarithm of times over that of their steps; None with fewer than two."""
    if len(times) < 2:
        return None
    slope, _ = np.polyfit(np.log(list(times)), np.log(list(times.values())), 1)
    return float(slope)


def grow(
    task: Task,
    methods: Sequence[Method],
    horizons: Sequence[int],
    runs: int,
    progress: Callable[[], None] = lambda: None,
) -> list[Growth]:
    """Time the first step of methods at several horizons, the methods in turn.

    A horizon at which a method's step does not bring the path nearer to the goal is left out.
    """
    times: dict[str, dict[int, float]] = {method.name: {} for method in methods}
    for steps in horizons:
        able = [each for each in methods if steps <= each.largest and _tries(task, each, steps)]
        samples = np.empty((runs, len(able)))
        with collector_off():
            for run in range(runs):
                for place, method in enumerate(able):
                    _first_step_time(task, method, steps)
                    samples[run, place] = _first_step_time(task, method, steps)
        for method, sample in zip(able, samples.T, strict=True):
            times[method.name][steps] = float(np.median(sample))
        progress()
    return [Growth.of(name, of_method) for name, of_method in times.items()]


def _tries(task: Task, method: Method, steps: int) -> bool:
    """Prepare a method; True if its step reduces the terminal error."""
    try:
        with unheard():
            method.prepare(steps)
            method.begin(steps)
            U = method.step(task.pose, task.guess(steps), task.durations(steps))
    except BenchError:
        return False
    return task.outcome(U).miss < task.outcome(task.guess(steps)).miss


def _first_step_time(task: Task, method: Method, steps: int) -> float:
    """Time of one first step [us]."""
    guess, durations = task.guess(steps), task.durations(steps)
    method.begin(steps)
    return timed(method.step, task.pose, guess, durations)


LONG_HORIZONS = (50, 100, 200, 400)

# Wheel-speed limit of Case 3 with which the outer wheel turns at it nearly all the way [rad/s].
LIMIT = 45.5

WARM, COLD = 'warm', 'cold'
# Those that solve the same quadratic programs, and can do so on long horizons.
QP_PEERS = ('sqpmethod + piqp', 'sqpmethod + hpipm')

_FIRST_ITERATIONS = 36
_SAMPLES = 5  # steps for each run

_BESIDE = 5e-3  # standard deviation of where the robot is from where the plan has it [m, m, rad]


@dataclass(frozen=True)
class LongStep:
    """Control steps at one horizon; times are medians."""

    steps: int  # ``N``
    active: float  # fraction of the wheel-speed bounds with a multiplier, of two for each step
    qp_iterations: float  # iterations in the last quadratic program of a warm step
    work: float  # visits of a stage in a warm step
    # Of two iterations that begin with the plan's active constraints (`WARM`), without them
    # (`COLD`), and of other solvers, by name [us].
    times: dict[str, float]
    # By other solver, median quotients of a warm step by its step, and by the time of its quadratic
    # programs alone.
    ratios: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class LongHorizons:
    """Control steps at each horizon, and why other solvers were not timed, by name."""

    found: list[LongStep]
    missing: dict[str, str]

    def exponent(self, name: str = WARM) -> float | None:
        """Exponent of ``N`` in a time."""
        return exponent({one.steps: one.times[name] for one in self.found if name in one.times})


def time_long_horizons(
    horizons: Sequence[int], runs: int, *, beside: bool, progress: Callable[[], None] = lambda: None
) -> LongHorizons:
    """Time control steps at several horizons, ours and other solvers' in turn."""
    result = LongHorizons([], {})
    for steps in horizons:
        result.found.append(
            _time_long_horizon(long_task(steps), runs * _SAMPLES, beside, result.missing)
        )
        progress()
    return result


def long_task(steps: int) -> Task:
    """Case 3 with the lower wheel-speed limit, with that many samples."""
    preset = Preset.load('case3')
    robot = replace(preset.settings.robot, max_wheel_speed=LIMIT)
    period = preset.settings.final_time / steps
    return Task.of(
        replace(preset, settings=replace(preset.settings, control_period=period, robot=robot))
    )


def _time_long_horizon(task: Task, samples: int, beside: bool, missing: dict[str, str]) -> LongStep:
    settings, steps = task.settings, task.steps
    planner, controls = Planner(OcpFormulation(settings, settings.world)), task.guess(steps)
    horizon = remaining(0, *map(to_nanoseconds, (settings.control_period, settings.final_time)))
    counts, rows = [], []

    def step(pose: Array, iterations: int | None = None) -> Array:
        """Improve the plan from a pose near its beginning; the plan itself stays."""
        context = PlanningContext.at_pose(settings, settings.world, pose, horizon, np.zeros(2))
        result = planner.improve(context, controls, iterations)
        if not result.solved or result.elastic:
            reason = 'it needs slack' if result.solved else result.reason
            raise BenchError(f'long horizons: found no plan ({reason})')
        # Controls at the end of the horizon move nothing, so their bounds do not count.
        bounds = planner._ws.program.stages['bounds'][:steps]  # noqa: SLF001
        active = np.count_nonzero(bounds) / bounds.size
        counts.append((active, result.qp_iterations, result.work))
        return result.plan.controls

    controls = step(task.pose, _FIRST_ITERATIONS)
    rng = np.random.default_rng(steps)
    poses = task.pose + rng.normal(scale=_BESIDE, size=(samples + 1, 3))
    others = _peers(task, controls, poses, missing) if beside else []
    with collector_off():
        for pose in poses:
            step(task.pose)
            times = [_timed(step, pose)]
            planner.forget()
            times.append(_timed(step, pose))
            for other in others:
                times.append(_timed(other.step, pose, controls, task.durations(steps)))
                times.append(other.qp_time(steps))
            rows.append(times)
    # The first steps do not count. Those that do are the second of three each.
    warm, cold, *taken = np.array(rows[1:]).T
    active, qp_iterations, work = np.median(counts[5::3], axis=0).tolist()
    medians, ratios = {WARM: float(np.median(warm)), COLD: float(np.median(cold))}, {}
    for other, whole, qps in zip(others, taken[::2], taken[1::2], strict=True):
        medians[other.name] = float(np.median(whole))
        ratios[other.name] = float(np.median(warm / whole)), float(np.median(warm / qps))
    return LongStep(steps, active, qp_iterations, work, medians, ratios)


def _peers(task: Task, controls: Array, poses: Array, missing: dict[str, str]) -> list[Any]:
    """Other solvers that solve the task from all poses; why others do not is written down."""
    known, without = peers(task)
    missing |= {name: why for name, why in without.items() if name in (*QP_PEERS, 'casadi')}
    able = []
    for method in known:
        if method.name not in QP_PEERS:
            continue
        reason, durations = '', task.durations(task.steps)
        try:
            with unheard():
                method.prepare(task.steps)
                for pose in poses:
                    U = method.step(pose, controls, durations)
                    reason = reason or task.failure(replace(task, pose=pose).outcome(U))
        except BenchError as error:
            reason = str(error)
        if reason:
            missing[f'{method.name}, N = {task.steps}'] = reason
        else:
            able.append(method)
    return able


def _timed(step: Callable[..., Array], *args: Array) -> float:
    """Computing time of a step, waiting for a processor left out [us]."""
    began = time.thread_time_ns()
    step(*args)
    return (time.thread_time_ns() - began) * 1e-3
