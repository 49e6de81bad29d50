"""A road for compiled code: one type and the same functions for every kind of road.

A kind of road is six functions like those below, called by their addresses, so that nothing but
them is compiled for it; they write their results to `RoadSpace.found`.

A place on a road is given by its progress [m], the length along the centre line from where it
begins: that is unique where a road comes by one point twice. Each road has two edges, and its
clearance from an edge is never more than the distance to it.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import address_of, allocation_free, call, inner
from cmpsp_ros.robots.motion import Arc

FAR = 1e6  # clearance from an edge that is not there [m]: a number that can be added

_PROJECT, _LATERAL_ERROR, _GRADIENTS, _SWEEP, _ARC_LENGTH_TO, _POINT_AHEAD = range(6)


class RoadSpace(NamedTuple):
    """The part of a road where the robot's centre may be; the first edge is the outer or left."""

    functions: IntArray  # addresses of the road's functions, see `addresses`
    numbers: Array  # their data on the road, in their own order; shared, never written to
    table: Array  # more data, in rows
    found: Array  # their output, shape ``(7,)``
    # for both edges, ``K`` stages or 1, ``(K, 2)`` [m]: of an annulus the greatest and the least
    # distance from the centre, of a corridor the clearance to keep
    kept: Array

    def with_some(self, samples: BoolArray, of: RoadSpace) -> RoadSpace:
        """Replace clearances as `FreeSpace.with_some` does."""
        return self._replace(kept=np.where(samples[:, None], of.kept, self.kept))


@cache
def addresses(*functions: Any) -> IntArray:
    """Addresses of the six functions of a kind of road, in the order of those below."""
    road = RoadSpace(
        np.zeros(1, np.int64), np.zeros(1), np.zeros((1, 1)), np.zeros(1), np.zeros((1, 2))
    )
    numbers = (0.0,) * 6
    examples = (
        numbers[:4], (0, *numbers[:3]), numbers[:3], (Arc(*(0.0,) * 10), *numbers[:3]), numbers,
        (*numbers[:4], (0.0, 0.0)),
    )  # fmt: skip
    pairs = zip(functions, examples, strict=True)
    return np.array([address_of(None, each, road, *given) for each, given in pairs])


@allocation_free
def project(road: RoadSpace, x: float, y: float, heading: float, near: float) -> float:
    """Progress of a pose [m]; where the road crosses itself, of a branch.

    The progress `near` a recent place selects it, else the heading; NaN for unknown.
    """
    call(road.functions[_PROJECT], (road, x, y, heading, near))
    progress: float = road.found[0]
    return progress


@allocation_free
def lateral_error(road: RoadSpace, k: int, x: float, y: float, progress: float) -> Any:
    """Position of a point across the road at a stage, from the progress of a point nearby.

    Progress, signed distance from the centre line, and one path constraint an edge, not positive
    where met and ``-inf`` where there is no edge; all [m].
    """
    at, found = min(k, road.kept.shape[0] - 1), road.found
    call(road.functions[_LATERAL_ERROR], (road, at, x, y, progress))
    return found[0], found[1], found[2], found[3]


@allocation_free
def gradients(road: RoadSpace, x: float, y: float, progress: float) -> Any:
    """Derivatives of the results of `lateral_error`, at the progress that it returned.

    The gradient of the distance from the centre line (x, y), a unit vector or zero; the component
    along the road of the second derivative of half its square; the gradients of both constraints.
    """
    found = road.found
    call(road.functions[_GRADIENTS], (road, x, y, progress))
    return found[0], found[1], found[2], found[3], found[4], found[5], found[6]


@allocation_free
def sweep(road: RoadSpace, arc: Arc, progress: float, enough: float, enough_other: float) -> Any:
    """Progress at the end of an arc, and least clearance from both edges of the first stage [m].

    Clearances need not be known more exactly above `enough`, or `enough_other` at the second edge.
    """
    call(road.functions[_SWEEP], (road, arc, progress, enough, enough_other))
    return road.found[0], road.found[1], road.found[2]


@allocation_free
def arc_length_to(
    road: RoadSpace, x: float, y: float, progress: float, goal_x: float, goal_y: float, goal: float
) -> float:
    """Signed length of the centre line from place to place, the shorter way round [m]."""
    call(road.functions[_ARC_LENGTH_TO], (road, x, y, progress, goal_x, goal_y, goal))
    length: float = road.found[0]
    return length


@allocation_free
def point_ahead(road: RoadSpace, x: float, y: float, progress: float, way: float, to: Any) -> Any:
    """Point (x, y) of the centre line some way ahead; on open floor, of the line to ``to`` [m]."""
    call(road.functions[_POINT_AHEAD], (road, x, y, progress, way, (to[0], to[1])))
    return road.found[0], road.found[1]


@inner
def no_progress(road: RoadSpace, _x: float, _y: float, _heading: float, _near: float) -> None:
    """Projection onto a road where no point is in two places."""
    road.found[0] = 0.0
