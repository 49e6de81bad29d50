"""How long the control steps of the presets take, all that the guidance law does in them."""

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
from cmpsp_ros.parameters.settings import check_start, guidance_settings
from cmpsp_ros.studies.bench.quiet import collector_off
from cmpsp_ros.studies.bench.spread import Spread
from cmpsp_ros.studies.closed_loop import drive

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Preset:
    """A preset that can be driven.

    Attributes:
        name: Of the preset, or its file.
        settings: Of the guidance law.
        pose: Where the robot starts, shape ``(3,)`` [m, m, rad].
    """

    name: str
    settings: GuidanceSettings
    pose: Array

    @classmethod
    def load(cls, name: str) -> Preset:
        """Read and check a preset or parameter file.

        Raises:
            ParameterError: No such preset, or one that cannot be used.
        """
        values = TABLE.resolve(load_parameter_file(name))
        check_start(values)
        return cls(name, guidance_settings(values), np.array(values['initial_pose']))


@dataclass(frozen=True)
class PresetTiming:
    """Computing times of one preset [ms].

    Attributes:
        name: Of the preset.
        first: Of the first step, which has the full horizon, over all runs.
        every: Of every step of all runs.
    """

    name: str
    first: Spread
    every: Spread


def measure(
    presets: Sequence[Preset], runs: int, progress: Callable[[], None] = lambda: None
) -> list[PresetTiming]:
    """Drive every preset in turn, again and again, and take the times.

    The presets are interleaved, so that whatever else the machine does falls on all of them.

    Args:
        presets: The presets.
        runs: Runs of each.
        progress: Told after each run.
    """
    for preset in presets:
        warm_up(preset.settings)
    times: list[list[list[float]]] = [[] for _ in presets]
    for _ in range(runs):
        for preset, of_runs in zip(presets, times, strict=True):
            of_runs.append(_step_times(preset.settings, preset.pose))
            progress()
    return [
        PresetTiming(
            preset.name,
            Spread.of([steps[0] for steps in of_runs]),
            Spread.of(np.concatenate(of_runs)),
        )
        for preset, of_runs in zip(presets, times, strict=True)
    ]


def _step_times(settings: GuidanceSettings, pose: Array) -> list[float]:
    """Computing time of each control step of one run, all of it [ms]."""
    times = []
    decisions = drive(settings, pose)
    finished = False
    with collector_off():
        while not finished:
            began = time.perf_counter_ns()
            finished = next(decisions).finished
            times.append((time.perf_counter_ns() - began) * 1e-6)
    # The last one only says that the run is over.
    return times[:-1]
