"""Open floor, for compiled code: no edges, no centre line, and the way to a place is straight."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import implements
from cmpsp_ros.robot import road_functions
from cmpsp_ros.robot.arcs import Arc
from cmpsp_ros.robot.between_samples import TwistLimits

Array = NDArray[np.float64]


class OpenSpace(NamedTuple):
    """The whole plane.

    Attributes:
        clearance: From its edges [m].
    """

    clearance: float = road_functions.FAR

    def for_samples(self, limits: TwistLimits, period: float) -> OpenSpace:  # noqa: ARG002
        """See `ClearSpace.for_samples`."""
        return self

    def for_samples_of(self, twists: Array, period: float) -> OpenSpace:  # noqa: ARG002
        """See `ClearSpace.for_samples_of`."""
        return self

    def with_some(self, samples: NDArray[np.bool_], of: OpenSpace) -> OpenSpace:  # noqa: ARG002
        """See `ClearSpace.with_some`."""
        return self


@implements(road_functions.find, OpenSpace)
def find(road: OpenSpace, x: float, y: float, heading: float, near: float) -> float:
    """Nothing to be found; see `road_functions.find`."""
    return 0.0


@implements(road_functions.measure, OpenSpace)
def measure(road: OpenSpace, k: int, x: float, y: float, progress: float) -> Any:
    """In the middle everywhere; see `road_functions.measure`."""
    return 0.0, 0.0, -math.inf, -math.inf


@implements(road_functions.slopes, OpenSpace)
def slopes(road: OpenSpace, x: float, y: float, progress: float) -> Any:
    """All zero; see `road_functions.slopes`."""
    return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@implements(road_functions.sweep, OpenSpace)
def sweep(road: OpenSpace, arc: Arc, progress: float, enough: float, enough_other: float) -> Any:
    """Far from all edges, if the arc is finite; see `road_functions.sweep`."""
    clearance = road.clearance + 0.0 * (arc.end_x + arc.end_y)
    return 0.0, clearance, clearance


@implements(road_functions.way_to, OpenSpace)
def way_to(
    road: OpenSpace,
    x: float,
    y: float,
    progress: float,
    goal_x: float,
    goal_y: float,
    goal: float,
) -> float:
    """The straight line; see `road_functions.way_to`."""
    return math.hypot(goal_x - x, goal_y - y)


@implements(road_functions.ahead, OpenSpace)
def ahead(road: OpenSpace, x: float, y: float, progress: float, way: float, to: Any) -> Any:
    """A point of the straight line; see `road_functions.ahead`."""
    left = max(math.hypot(to[0] - x, to[1] - y), 1e-9)
    return x + (to[0] - x) * (way / left), y + (to[1] - y) * (way / left)
