"""Clearance of the driven path, also between samples, from the obstacles at that time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.audit.history import History
from cmpsp_ros.bags.runs.run import Driven
from cmpsp_ros.guidance.settings import GuidanceSettings

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

EDGES = 2
"""The first columns of a clearance are the road's edges."""


@dataclass(frozen=True)
class Sweep:
    """Arcs with the clearance of the robot itself.

    Attributes:
        settings: Settings in force.
        stamps: Beginning of each arc [ns], shape ``(K,)``.
        clearance: From both road edges and each obstacle, shape ``(K, 2 + M)`` [m].
    """

    settings: GuidanceSettings
    stamps: Stamps
    clearance: Array

    def name(self, column: int) -> str:
        """What a column of the clearance is about."""
        if column < EDGES:
            return str(self.settings.road.edge_names[column])
        return f'obstacle {self.settings.obstacles[column - EDGES].name}'


def sweep(path: Driven, history: History) -> Iterator[Sweep]:
    """The arcs of a path, by the parameters in force at the beginning of each."""
    begins = path.stamps[:-1]
    edges = np.searchsorted(begins, [each.since for each in history.epochs[1:]])
    for epoch, index in zip(history.epochs, np.split(np.arange(len(begins)), edges), strict=True):
        if len(index):
            arcs = path.poses[index], path.twists[index], path.durations[index]
            clearance = epoch.settings.clearance(*arcs)
            yield Sweep(epoch.settings, begins[index], clearance)
