"""One plan's control step over the horizon, with about half of the wheel-speed bounds active."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, cast

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import remaining, to_nanoseconds
from cmpsp_ros.guidance.planner import Planner
from cmpsp_ros.studies.bench.errors import BenchError
from cmpsp_ros.studies.bench.methods import Method
from cmpsp_ros.studies.bench.peers import peers
from cmpsp_ros.studies.bench.presets import Preset
from cmpsp_ros.studies.bench.quiet import collector_off, unheard
from cmpsp_ros.studies.bench.task import Task

Array = NDArray[np.float64]

LONG_HORIZONS = (50, 100, 200, 400)

LIMIT = 45.5
"""Wheel-speed limit of Case 3 with which the outer wheel turns at it nearly all the way [rad/s]."""

QP_PEERS = ('sqpmethod + piqp', 'sqpmethod + hpipm')
"""Those that solve the same quadratic programs, and can do so on long horizons."""

_SAMPLES = 5
"""Steps for each run."""

_FIRST_ITERATIONS = 36
"""Of the plan that the steps begin with."""

_BESIDE = 5e-3
"""Standard deviation of where the robot is from where the plan has it [m, m, rad]."""


class _QpMethod(Method, Protocol):
    """A method that knows what its quadratic programs took."""

    def qp_time(self, steps: int) -> float:
        """Time of those of the last step with so many [us]."""


@dataclass(frozen=True)
class Peer:
    """Another solver's time for the same step.

    Attributes:
        time: Of its two iterations; median [us].
        ratio: Median quotient of ours by it.
        ratio_of_qps: The same by the time of its two quadratic programs alone.
    """

    time: float
    ratio: float
    ratio_of_qps: float


@dataclass(frozen=True)
class LongStep:
    """Control steps at one horizon; times are medians.

    Attributes:
        steps: ``N``.
        active: Fraction of the wheel-speed bounds that is active, on each stage either of the two
            for each wheel.
        warm: Two iterations from the plan and its active constraints [us].
        cold: Two iterations from the plan, its active constraints forgotten [us].
        qp_iterations: Iterations in the last quadratic program of the warm step.
        work: Visits of a stage in the warm step.
        peers: Other solvers, by name.
    """

    steps: int
    active: float
    warm: float
    cold: float
    qp_iterations: float
    work: float
    peers: dict[str, Peer]


@dataclass(frozen=True)
class LongHorizons:
    """Control steps over horizons.

    Attributes:
        found: At each horizon.
        missing: Why other solvers were not timed, by name.
    """

    found: list[LongStep]
    missing: dict[str, str]

    @property
    def names(self) -> list[str]:
        """Solvers that were timed at one horizon at least."""
        return [name for name in QP_PEERS if any(name in each.peers for each in self.found)]

    def exponent(self, name: str = 'warm') -> float | None:
        """Slope of the logarithm of a time over that of ``N``; None with fewer than two horizons.

        Args:
            name: `warm`, `cold` or the name of another solver.
        """
        times = {}
        for each in self.found:
            known = {'warm': each.warm, 'cold': each.cold}
            known |= {peer: of_peer.time for peer, of_peer in each.peers.items()}
            if name in known:
                times[each.steps] = known[name]
        if len(times) < 2:
            return None
        slope, _ = np.polyfit(np.log(list(times)), np.log(list(times.values())), 1)
        return float(slope)


def measure(
    horizons: Sequence[int], runs: int, *, beside: bool, progress: Callable[[], None] = lambda: None
) -> LongHorizons:
    """Time control steps at several horizons, ours and other solvers' in turn.

    Args:
        horizons: Numbers of steps.
        runs: Repetitions, of several steps each.
        beside: Whether other solvers take part.
        progress: Told after each horizon.

    Raises:
        BenchError: There is no plan to begin with.
    """
    found: list[LongStep] = []
    missing: dict[str, str] = {}
    for steps in horizons:
        task = long_task(steps)
        ours = _Ours(task, steps)
        rng = np.random.default_rng(steps)
        offsets = rng.normal(scale=_BESIDE, size=(runs * _SAMPLES + 1, 3))
        poses = list(task.pose + offsets)
        methods, without = _peers(task, ours, poses) if beside else ([], {})
        missing |= without
        found.append(_measure(task, ours, methods, poses))
        progress()
    return LongHorizons(found, missing)


def long_task(steps: int) -> Task:
    """Case 3 at the wheel-speed limit, sampled so many times."""
    preset = Preset.load('case3')
    settings = replace(
        preset.settings,
        control_period=preset.settings.final_time / steps,
        robot=replace(preset.settings.robot, max_wheel_speed=LIMIT),
    )
    return Task.of(replace(preset, settings=settings))


def _peers(
    task: Task, ours: _Ours, poses: Sequence[Array]
) -> tuple[list[_QpMethod], dict[str, str]]:
    """Other solvers that take all these steps, and why others do not."""
    known, missing = peers(task)
    missing = {name: why for name, why in missing.items() if name in (*QP_PEERS, 'casadi')}
    able: list[_QpMethod] = []
    for method in known:
        if method.name in QP_PEERS:
            if reason := _failure(task, method, ours.controls, poses):
                missing[f'{method.name}, N = {task.steps}'] = reason
            else:
                able.append(cast(_QpMethod, method))
    return able, missing


def _failure(task: Task, method: Method, controls: Array, poses: Sequence[Array]) -> str:
    """Why a method's steps do not solve the task; empty where they do."""
    method.prepare(task.steps)
    try:
        for pose in poses:
            with unheard():
                U = method.step(pose, controls, task.durations(task.steps))
            if reason := task.failure(replace(task, pose=pose).outcome(U)):
                return reason
    except BenchError as error:
        return str(error)
    return ''


class _Ours:
    """A planner, and a plan that it has made from the start."""

    def __init__(self, task: Task, steps: int) -> None:
        settings = task.settings
        period, final = map(to_nanoseconds, (settings.control_period, settings.final_time))
        self._horizon, self._planner = remaining(0, period, final), Planner(settings)
        self.controls = task.guess(steps)
        self.controls = self.step(task.pose, _FIRST_ITERATIONS)

    def forget(self) -> None:
        """Begin the next step without active constraints."""
        self._planner.forget()

    def step(self, pose: Array, iterations: int | None = None) -> Array:
        """Improve the plan from a pose near its beginning; the plan itself stays.

        Raises:
            BenchError: The result may not be followed.
        """
        improvement = self._planner.improve(
            pose, np.zeros(2), self.controls, self._horizon, iterations=iterations
        )
        if not improvement.solved or improvement.elastic:
            reason = 'it needs slack' if improvement.solved else improvement.reason
            raise BenchError(f'long horizons: found no plan ({reason})')
        self.qp_iterations, self.work = improvement.qp_iterations, improvement.work
        return improvement.plan.controls

    def active(self) -> float:
        """Fraction of the wheel-speed bounds that has a multiplier."""
        steps = len(self._horizon.durations)
        # That of the last controls, which move nothing, does not count.
        bounds = self._planner._ws.program.stages['bounds'][:steps]  # noqa: SLF001
        return np.count_nonzero(bounds) / bounds.size


def _measure(
    task: Task, ours: _Ours, methods: Sequence[_QpMethod], poses: Sequence[Array]
) -> LongStep:
    steps = task.steps
    durations = task.durations(steps)
    counts, rows = [], []
    with collector_off():
        for pose in poses:
            ours.step(task.pose)
            row = [_timed(ours.step, pose)]
            counts.append((ours.active(), ours.qp_iterations, ours.work))
            ours.forget()
            row.append(_timed(ours.step, pose))
            for method in methods:
                row.append(_timed(method.step, pose, ours.controls, durations))
                row.append(method.qp_time(steps))
            rows.append(row)
    # The first step loads what others have driven from the caches.
    warm, cold, *others = np.array(rows[1:]).T
    active, qp_iterations, work = np.median(counts[1:], axis=0).tolist()
    beside = {
        method.name: Peer(
            float(np.median(whole)), float(np.median(warm / whole)), float(np.median(warm / qps))
        )
        for method, whole, qps in zip(methods, others[::2], others[1::2], strict=True)
    }
    medians = float(np.median(warm)), float(np.median(cold))
    return LongStep(steps, active, *medians, qp_iterations, work, beside)


def _timed(step: Callable[..., Array], *args: Array) -> float:
    """Computing time of a step, waiting for a processor left out [us]."""
    began = time.thread_time_ns()
    step(*args)
    return (time.thread_time_ns() - began) * 1e-3
