"""The project's own methods."""

from __future__ import annotations

from collections.abc import Callable

from cmpsp_ros.studies.bench.condensed_method import CondensedDaqp
from cmpsp_ros.studies.bench.guidance_methods import FullStep, Law
from cmpsp_ros.studies.bench.methods import Method
from cmpsp_ros.studies.bench.riccati_method import RiccatiActiveSet
from cmpsp_ros.studies.bench.task import Task

OURS: tuple[Callable[[Task], Method], ...] = (CondensedDaqp, RiccatiActiveSet, FullStep, Law)
"""The first of them is what all others are compared with; the rest are what is driven with."""
