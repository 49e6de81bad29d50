"""Times and horizons: integer nanoseconds, so that a run repeats exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray

NANOSECONDS = 1_000_000_000

NEVER: Final = 2**62  # a time that does not come [ns]


def to_nanoseconds(seconds: float) -> int:
    """Seconds as a whole number of nanoseconds, to the nearest; infinite ones are `NEVER`."""
    return round(seconds * NANOSECONDS) if seconds < math.inf else NEVER


class Horizon(NamedTuple):
    """Instants between which each control of a plan is held."""

    edges: IntArray  # the present, the control instants to come and the end, ``(N + 1,)`` [ns]
    durations: Array  # length of each step, shape ``(N,)`` [s]

    @classmethod
    def between(cls, instants: Sequence[int] | IntArray) -> Horizon:
        """The horizon of these instants [ns]."""
        edges = np.asarray(instants, dtype=np.int64)
        return cls(edges, (edges[1:] - edges[:-1]) / NANOSECONDS)
