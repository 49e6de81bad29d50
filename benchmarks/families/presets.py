"""How long control steps take, all that the guidance law does in them."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.families.spread import Spread
from benchmarks.quiet import collector_off
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import Decision, GuidanceLaw, GuidanceSettings, Observation, to_nanoseconds
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.parameters import TABLE, check_start, guidance_settings, load_parameter_file
from cmpsp_ros.parameters.files import preset_names
from cmpsp_ros.studies.paper import table1, table2


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


def chosen(names: Sequence[str]) -> list[Preset]:
    """Presets of these names; without any, all presets and the runs of the paper's tables.

    From most starts of the latter the first plans need slack.

    Raises:
        ParameterError: No such preset, or one that cannot be used.
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

    The presets are interleaved, so that other work of the machine falls on all of them.
    """
    # One run that does not count has all compiled code loaded.
    for preset in presets:
        _step_times(preset)
    times: list[list[list[float]]] = [[] for _ in presets]
    for _ in range(runs):
        for preset, of_runs in zip(presets, times, strict=True):
            of_runs.append(_step_times(preset))
            progress()
    return [
        PresetTiming(
            preset.name,
            Spread.of([steps[0] for steps in of_runs]),
            Spread.of(np.concatenate(of_runs)),
        )
        for preset, of_runs in zip(presets, times, strict=True)
    ]


def _step_times(preset: Preset) -> list[float]:
    """Computing time of each control step of one run [ms]."""
    return [took for took, *_ in drive(preset.settings, preset.pose)]


def drive(
    settings: GuidanceSettings,
    pose: Array,
    clock: Callable[[], int] = time.perf_counter_ns,
    tracks: Callable[[int], tuple[Track, ...]] = lambda _: (),
) -> Iterator[tuple[float, Decision, Array]]:
    """One run by the exact model, commands held for a control period.

    Args:
        settings: Of the guidance law.
        pose: Where the robot starts, shape ``(3,)`` [m, m, rad].
        clock: What the steps are timed with [ns].
        tracks: Moving obstacles at a time [ns].

    Yields:
        Of each control step the computing time [ms], the decision, and the pose that it leads to.
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
