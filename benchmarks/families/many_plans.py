"""How a control step's time grows with the number of plans that are improved side by side."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from benchmarks.errors import BenchError
from benchmarks.families.presets import Preset
from benchmarks.quiet import collector_off
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceLaw, GuidanceSettings, Observation, to_nanoseconds
from cmpsp_ros.world.obstacles import Obstacle

COUNTS: Final = (1, 2, 4, 8)

# Small and on the centre line: all ways past them are about as good.
_BEARINGS = (-65.0, -48.0, -31.0, -14.0)
_RADIUS = 0.15


@dataclass(frozen=True)
class Plans:
    """Control steps in which a number of plans are improved and compared.

    Attributes:
        count: How many.
        first: Of the first step, which looks for the ways that they take, shape ``(runs,)`` [us].
        second: Of the one after it, shape ``(runs,)`` [us].
    """

    count: int
    first: Array
    second: Array


def measure(
    runs: int, counts: Sequence[int] = COUNTS, progress: Callable[[], None] = lambda: None
) -> list[Plans]:
    """Begin Case 3 past four small obstacles on the centre line, all numbers of plans in turn.

    Args:
        runs: Runs of each; one more has all compiled code loaded.
        counts: Numbers of plans, at most as many as there are ways: 16.
        progress: Told after each run of all of them.

    Raises:
        BenchError: Not so many plans were made.
    """
    preset = Preset.load('case3')
    every = {count: _settings(preset.settings, count) for count in counts}
    laws = {count: GuidanceLaw(each, each.world) for count, each in every.items()}
    times = np.empty((len(counts), runs + 1, 2))
    for run in range(runs + 1):
        for i, (count, law) in enumerate(laws.items()):
            times[i, run] = _two_steps(law, preset, count)
        progress()
    return [Plans(count, times[i, 1:, 0], times[i, 1:, 1]) for i, count in enumerate(counts)]


def _settings(settings: GuidanceSettings, count: int) -> GuidanceSettings:
    middle = settings.world.annulus.center_radius
    obstacles = tuple(
        Obstacle(
            f'at_{bearing:g}',
            (middle * math.cos(math.radians(bearing)), middle * math.sin(math.radians(bearing))),
            _RADIUS,
        )
        for bearing in _BEARINGS
    )
    guess = replace(settings.initial_guess, type='road')
    # As many iterations in the first step as in any other.
    each = settings.solver.iterations_per_step
    solver = replace(settings.solver, candidates=count, initial_iterations=each)
    return replace(settings, obstacles=obstacles, initial_guess=guess, solver=solver)


def _two_steps(law: GuidanceLaw, preset: Preset, count: int) -> tuple[float, float]:
    """Computing times of the first two control steps [us]."""
    settings, pose = preset.settings, preset.pose
    law.reset()
    with collector_off():
        began = time.perf_counter_ns()
        decision = law.step(Observation(0, pose))
        first = time.perf_counter_ns() - began
        if decision is None:
            raise BenchError('plans: found no decision on the first odometry')
        held = np.array([settings.control_period])
        pose = settings.robot.roll_out(pose, decision.wheel_speeds[None], held)[-1]
        began = time.perf_counter_ns()
        decision = law.step(Observation(to_nanoseconds(settings.control_period), pose))
        second = time.perf_counter_ns() - began
    if count > 1 and (decision is None or f'best of {count} plans' not in decision.reason):
        found = None if decision is None else decision.reason
        raise BenchError(f'plans: found {found!r}, wanted the best of {count} plans')
    return first * 1e-3, second * 1e-3
