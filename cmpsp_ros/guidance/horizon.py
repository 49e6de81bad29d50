"""The horizon from the clock: a fixed final time, and control instants on a fixed grid before it.

Times are integer nanoseconds since time 0, so that a run repeats exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NANOSECONDS = 1_000_000_000


def to_nanoseconds(seconds: float) -> int:
    """Seconds as a whole number of nanoseconds, to the nearest."""
    return round(seconds * NANOSECONDS)


@dataclass(frozen=True)
class Horizon:
    """Instants between which each control of a plan is held.

    Attributes:
        edges: The present, the control instants to come and the end [ns], shape ``(N + 1,)``.
    """

    edges: NDArray[np.int64]

    @property
    def durations(self) -> Array:
        """Length of each step, shape ``(N,)`` [s]."""
        return np.diff(self.edges) / NANOSECONDS

    @property
    def next_instant(self) -> int:
        """When the next control step falls due [ns]."""
        return int(self.edges[1])


def remaining(now: int, period: int, final: int) -> Horizon:
    """The horizon from now to the final time.

    Control instants are whole multiples of the period. One that is nearer than half a period to
    the present or to the final time is left out, so that late odometry never makes a step so
    short that it asks for a violent command; for the same reason a horizon is never shorter than
    half a period, even if it then ends after the final time.

    Args:
        now: Present time [ns], before the final time.
        period: Control period [ns].
        final: Final time [ns].
    """
    half = period // 2
    first = -(-(now + half) // period)
    last = (final - half) // period
    instants = np.arange(first, last + 1, dtype=np.int64) * period
    return Horizon(np.concatenate([[now], instants, [max(final, now + half)]]).astype(np.int64))


def shift(controls: Array, old: Horizon, new: Horizon) -> Array:
    """A plan's controls on a later horizon: what it holds at the middle of each new step.

    Args:
        controls: Plan on the old horizon, shape ``(N + 1, r)``.
        old: Its horizon.
        new: The horizon wanted, of ``M`` steps.

    Returns:
        Shape ``(M + 1, r)``; beyond the old horizon's end its last step is continued.
    """
    middles = (new.edges[:-1] + new.edges[1:]) // 2
    held = np.searchsorted(old.edges, middles, side='right') - 1
    held = np.clip(held, 0, len(old.edges) - 2)
    return np.vstack([controls[held], controls[-1]])
