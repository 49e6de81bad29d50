"""Clearance of the driven path, also between samples, from the obstacles at that time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.audit.history import History
from cmpsp_ros.bags.runs.run import Driven
from cmpsp_ros.bags.runs.seen import Seen
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.world.roads import FAR

EDGES = 2
"""The first columns of a clearance are the road's edges."""

OUT_OF_REACH = 1e3
"""Clearance from which on nothing is within reach [m]."""

NOTHING_NEAR = 'No road edge and no obstacle is within reach.'


@dataclass(frozen=True)
class Sweep:
    """Arcs with the clearance of the robot itself.

    Attributes:
        settings: Settings in force.
        stamps: Beginning of each arc [ns], shape ``(K,)``.
        clearance: From both road edges and each obstacle, shape ``(K, 2 + M)`` [m].
        names: Of its columns, in messages.
        by: Source of the path, if it is not odometry.
        tolerance: What the clearance may be off by; less than that is no proof of a contact [m].
    """

    settings: GuidanceSettings
    stamps: IntArray
    clearance: Array
    names: tuple[str, ...]
    by: str = ''
    tolerance: float = 0.0

    @classmethod
    def of_seen(cls, settings: GuidanceSettings, seen: Seen) -> Sweep:
        """The distance from what sensors saw, which know no road."""
        clearance = np.full((len(seen.stamps), EDGES + 1), FAR)
        np.minimum(seen.clearance, FAR, out=clearance[:, EDGES])
        names = (*settings.road.edge_names, 'what the sensors saw')
        return cls(settings, seen.stamps, clearance, names, tolerance=seen.tolerance)


def sweep(
    path: Driven, history: History, by: str = '', tolerance: float = 0.0, off: float = 0.0
) -> Iterator[Sweep]:
    """The arcs of a path, by the parameters in force at the beginning of each.

    Args:
        path: The path.
        history: The parameters.
        by: As of `Sweep`.
        tolerance: As of `Sweep`.
        off: What the path is off the true one [m]: those obstacles that only the simulator knows
            count as so much farther away.
    """
    begins = path.stamps[:-1]
    edges = np.searchsorted(begins, history.starts[1:])
    for epoch, index in zip(history.epochs, np.split(np.arange(len(begins)), edges), strict=True):
        if len(index):
            arcs = path.poses[index], path.twists[index], path.durations[index]
            settings = epoch.course
            obstacles = (f'obstacle {each.name}' for each in settings.obstacles)
            names = (*settings.road.edge_names, *obstacles)
            clearance = settings.world.clearance(settings, *arcs)
            clearance[:, EDGES:][:, epoch.of_hidden] += off
            yield Sweep(settings, begins[index], clearance, names, by, tolerance)
