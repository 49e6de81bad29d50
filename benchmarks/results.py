"""What is asked of a benchmark, and what it comes to."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.families.general import General
from benchmarks.families.hard_cases import HardCase
from benchmarks.families.horizons import HORIZONS, Growth
from benchmarks.families.long_horizons import LONG_HORIZONS, LongHorizons
from benchmarks.families.many_plans import Plans
from benchmarks.families.presets import PresetTiming
from benchmarks.families.robot_drives import RobotDrive, robots_that_fit
from benchmarks.families.tail import Tail
from benchmarks.families.timing import Comparison

if TYPE_CHECKING:
    from benchmarks.over_dds.latency import Latency

COMPARED_STEPS = 50
"""Steps of Case 3."""


@dataclass(frozen=True)
class Order:
    """What to measure, and where to write it.

    Attributes:
        presets: Names of presets or parameter files whose control steps are timed; none for all
            presets and the runs of the paper's tables.
        runs: Runs of each of them, and of each method.
        tail: Control steps of which the longest are looked at.
        peers: Whether other people's solvers take part.
        latency: Whether the node is timed over DDS.
        output: A file that ends in `.json`, or a folder; None to write nothing.
        steps: Steps of the full horizon where methods are compared.
        horizons: Numbers of steps over which their growth is measured.
        robots: Robots that drive on long horizons.
        long_horizons: Numbers of steps over which one plan's control step is measured.
    """

    presets: Sequence[str]
    runs: int
    tail: int
    peers: bool = False
    latency: bool = False
    output: Path | None = None
    steps: int = COMPARED_STEPS
    horizons: Sequence[int] = HORIZONS
    robots: Sequence[str] = field(default_factory=robots_that_fit)
    long_horizons: Sequence[int] = LONG_HORIZONS

    @property
    def command(self) -> str:
        """The command line that asks for it."""
        options = [name for name in ('peers', 'latency') if getattr(self, name)]
        words = ['cmpsp', 'bench', *self.presets, '--runs', str(self.runs)]
        words += ['--tail', str(self.tail)]
        words += [f'--{name}' for name in options]
        if self.output is not None:
            words += ['--output', str(self.output)]
        return shlex.join(words)


@dataclass(frozen=True)
class Results:
    """All that was measured.

    Attributes:
        order: What was asked.
        machine: What it was measured on.
        robots: Robots on long horizons.
        models: A differential drive and a car on one course.
        long_horizons: One plan's control steps over long horizons.
        presets: Control steps of the presets.
        comparison: Methods at one horizon.
        tails: Many control steps of the project's own methods.
        hard: Full steps of hard cases.
        plans: Control steps with several plans side by side.
        growth: Methods over horizons.
        general: Programs of other sizes than the robot's.
        missing: Why other methods took no part, by name.
        latency: Over DDS; None if it was not asked.
        resident: Resident set of this process at the end [MB].
    """

    order: Order
    machine: dict[str, str]
    robots: list[RobotDrive]
    models: list[RobotDrive]
    long_horizons: LongHorizons
    presets: list[PresetTiming]
    comparison: Comparison
    tails: list[Tail]
    hard: list[HardCase]
    plans: list[Plans]
    growth: list[Growth]
    general: list[General]
    missing: dict[str, str]
    latency: Latency | None
    resident: float
