"""The horizon to a fixed final time, with control instants on a grid, and plans on a later one."""

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.guidance.times import NANOSECONDS, Horizon
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Robot


def remaining(now: int, period: int, final: int) -> Horizon:
    """Horizon from `now` to the final time; edges at multiples of the period, all in [ns].

    An instant nearer than half a period to the present or the final time is left out: no step is so
    short that it asks for a violent command. A horizon lasts at least half a period.
    """
    half = period // 2
    first = -(-(now + half) // period)
    last = max((final - half) // period, first - 1)
    edges, durations = np.empty(last - first + 3, np.int64), np.empty(last - first + 2)
    _fill(edges, durations, now, max(final, now + half), first, period)
    return Horizon(edges, durations)


@allocation_free
def _fill(edges: IntArray, durations: Array, now: int, end: int, first: int, period: int) -> None:
    edges[0], edges[-1] = now, end
    for k in range(1, len(durations)):
        edges[k] = (first + k - 1) * period
    for k in range(len(durations)):
        durations[k] = (edges[k + 1] - edges[k]) / NANOSECONDS


def shift(controls: Array, old: Horizon, new: Horizon) -> Array:
    """Controls ``(M + 1, r)`` of a plan ``(N + 1, r)`` on a later horizon, read at mid-step.

    Beyond the old horizon its last step is continued; the last row, which moves nothing, is kept.
    """
    shifted = np.empty((len(new.edges), controls.shape[1]))
    _shift(shifted, controls, old.edges, new.edges)
    return shifted


@allocation_free
def _shift(shifted: Array, controls: Array, old: IntArray, new: IntArray) -> None:
    held, last = 0, len(old) - 2
    for k in range(len(new) - 1):
        middle = (new[k] + new[k + 1]) // 2
        while held < last and old[held + 1] <= middle:
            held += 1
        for a in range(controls.shape[1]):
            shifted[k, a] = controls[held, a]
    for a in range(controls.shape[1]):
        shifted[-1, a] = controls[-1, a]


def retimed(controls: Array, old: Horizon, new: Horizon, robot: Robot) -> Array:
    """Controls ``(N + 1, r)`` of a plan driven faster or slower, to end with a horizon."""
    begin = int(new.edges[0])
    left = int(old.edges[-1]) - begin
    pace = left / int(new.edges[-1] - begin)
    if pace == 1.0 or left <= 0:
        return shift(controls, old, new)
    edges, driven = begin + (old.edges - begin) / pace, np.zeros_like(controls)
    np.cumsum(controls[:-1] * np.diff(edges)[:, None], axis=0, out=driven[1:])
    found = np.empty((len(new.edges), controls.shape[1]))
    for a, each in enumerate(driven.T):
        found[:-1, a] = np.diff(np.interp(new.edges, edges, each)) / np.diff(new.edges)
    found[-1] = controls[-1]
    return robot.slowed(found, pace)
