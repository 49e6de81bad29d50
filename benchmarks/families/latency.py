"""Latency of the guidance node: what is known of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.families.spread import Spread

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Latency:
    """What was measured in some runs of one preset.

    Attributes:
        runs: How many there were.
        total: From just before odometry is published to the callback with the command that answers
            it, of every control step [ms].
        own: Of that, from the guidance node's callback to its publishing, by its own clock [ms].
        first: Which of the steps are the first of their run, when the robot stands and plans are
            made from nothing, shape of `total`.
        jitter: Change of the total from one control step of a run to the next [ms].
        miss: Largest distance from the goal at the final time, of all runs [m].
        starts: From the start of the guidance node's process to its being active, once for each
            run; it is configured and activated from outside as soon as it answers [s].
        resident_active: Resident set of the guidance node when it becomes active [MB].
        resident_end: The same at the end of the last run [MB].
    """

    runs: int
    total: Array
    own: Array
    first: NDArray[np.bool_]
    jitter: Array
    miss: float
    starts: Array
    resident_active: float
    resident_end: float

    @property
    def under_way(self) -> Spread:
        """The total, but for first steps [ms]."""
        return Spread.of(self.total[~self.first])

    @property
    def rest(self) -> Spread:
        """What is not the node's own: middleware, executor, scheduler [ms]."""
        return Spread.of(self.total - self.own)
