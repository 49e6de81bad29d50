"""How long the control steps of the presets take, in this process."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.law import warm_up
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file
from cmpsp_ros.parameters.settings import guidance_settings
from cmpsp_ros.studies.closed_loop import drive

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Timing:
    """Computing times of one preset [ms].

    Attributes:
        preset: Its name.
        first: Median over all runs of the first step, which has the full horizon.
        median: Median over all runs of the median step of a run.
        p99: 99th percentile over all steps.
        largest: Longest of all steps.
    """

    preset: str
    first: float
    median: float
    p99: float
    largest: float


def measure(
    presets: Sequence[str], runs: int, progress: Callable[[], None] = lambda: None
) -> list[Timing]:
    """Drive every preset in turn, again and again, and take the times.

    The presets are interleaved, so that whatever else the machine does falls on all of them.

    Args:
        presets: Names of presets, or parameter files.
        runs: Runs of each.
        progress: Told after each run.

    Raises:
        ParameterError: No such preset, or one that cannot be used.
    """
    values = [TABLE.resolve(load_parameter_file(preset)) for preset in presets]
    settings = [guidance_settings(each) for each in values]
    for each in settings:
        warm_up(each)
    times: dict[str, list[list[float]]] = {preset: [] for preset in presets}
    for _ in range(runs):
        for preset, value, each in zip(presets, values, settings, strict=True):
            times[preset].append(_step_times(each, np.array(value['initial_pose'])))
            progress()
    return [_timing(preset, of_runs) for preset, of_runs in times.items()]


def _step_times(settings: GuidanceSettings, pose: Array) -> list[float]:
    """Computing time of each control step of one run, all of it [ms]."""
    times = []
    decisions = drive(settings, pose)
    finished = False
    while not finished:
        began = time.perf_counter_ns()
        finished = next(decisions).finished
        times.append((time.perf_counter_ns() - began) * 1e-6)
    return times[:-1]


def _timing(preset: str, of_runs: list[list[float]]) -> Timing:
    every = np.concatenate(of_runs)
    return Timing(
        preset,
        float(np.median([steps[0] for steps in of_runs])),
        float(np.median([np.median(steps) for steps in of_runs])),
        float(np.percentile(every, 99)),
        float(every.max()),
    )
