"""The project's own methods."""

from __future__ import annotations

from collections.abc import Callable

from benchmarks.families.task import Task
from benchmarks.methods.condensed_method import CondensedDaqp
from benchmarks.methods.guidance_methods import FullStep, Law
from benchmarks.methods.method import Method
from benchmarks.methods.riccati_method import RiccatiActiveSet

OURS: tuple[Callable[[Task], Method], ...] = (CondensedDaqp, RiccatiActiveSet, FullStep, Law)
"""The first of them is what all others are compared with; the rest are what is driven with."""
