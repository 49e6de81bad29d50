"""The horizon to the final time, and plans on a later horizon.

The final time is fixed, and control instants are on a fixed grid before it.
"""

from __future__ import annotations

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.guidance.times import NANOSECONDS, Horizon
from cmpsp_ros.mpsp.jit import allocation_free


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
    last = max((final - half) // period, first - 1)
    edges, durations = np.empty(last - first + 3, dtype=np.int64), np.empty(last - first + 2)
    _fill(edges, durations, now, max(final, now + half), first, period)
    return Horizon(edges, durations)


def shift(controls: Array, old: Horizon, new: Horizon) -> Array:
    """A plan's controls on a later horizon: what it holds at the middle of each new step.

    Args:
        controls: Plan on the old horizon, shape ``(N + 1, r)``.
        old: Its horizon.
        new: The horizon wanted, of ``M`` steps.

    Returns:
        Shape ``(M + 1, r)``; beyond the old horizon's end its last step is continued, and the last
        row, which moves nothing, is the same.
    """
    shifted = np.empty((len(new.edges), controls.shape[1]))
    _shift(shifted, controls, old.edges, new.edges)
    return shifted


@allocation_free
def _shift(shifted: Array, controls: Array, old: IntArray, new: IntArray) -> None:
    held, last = 0, old.shape[0] - 2
    for k in range(new.shape[0] - 1):
        middle = (new[k] + new[k + 1]) // 2
        while held < last and old[held + 1] <= middle:
            held += 1
        for a in range(controls.shape[1]):
            shifted[k, a] = controls[held, a]
    for a in range(controls.shape[1]):
        shifted[-1, a] = controls[-1, a]


@allocation_free
def _fill(edges: IntArray, durations: Array, now: int, end: int, first: int, period: int) -> None:
    """Fill in the present, the multiples of the period from the ``first`` on, and the end."""
    steps = durations.shape[0]
    edges[0], edges[steps] = now, end
    for k in range(1, steps):
        edges[k] = (first + k - 1) * period
    for k in range(steps):
        durations[k] = (edges[k + 1] - edges[k]) / NANOSECONDS
