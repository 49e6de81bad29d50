"""Roads, open floor, which is no road at all, and arc lengths along a centre line."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free, inner
from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.robots.motion import Arc
from cmpsp_ros.world.roads import road_functions
from cmpsp_ros.world.roads.road_functions import FAR, RoadSpace, addresses, no_progress

Point = tuple[float, float]

# Distance beyond an edge that no driving robot reaches, as a fraction of the road's width.
_BEYOND: Final = 0.25


class Road(ABC):
    """A road: a frozen dataclass, equal by its values, and compiled functions of its `numbers`."""

    edge_names: ClassVar[tuple[str, str]]  # names of the first and the second edge in messages

    has_center_line: ClassVar[bool] = True  # true for a road with edges and a line between them

    has_progress: ClassVar[bool] = False
    """True where a point can be on it in two places, which the progress tells apart."""

    functions: ClassVar[tuple[Callable[..., None], ...]]
    """Compiled functions, in the order of `road_functions.addresses`."""

    @property
    @abstractmethod
    def numbers(self) -> Array:
        """Numbers that its compiled functions use."""

    @property
    def table(self) -> Array:
        """More numbers, in rows."""
        return np.zeros((1, 1))

    @property
    @abstractmethod
    def width(self) -> float:
        """Maximum width from edge to edge, or the size for a picture [m]."""

    @property
    def lap(self) -> float:
        """Length of the centre line of a road without end; 0 where it has one [m]."""
        return 0.0

    @property
    def clearance_scale(self) -> Array:
        """Fraction of the distance to either edge that counts as clearance, shape ``(2,)``."""
        return np.ones(2)

    def kept(self, distance: float) -> Array:
        """`RoadSpace.kept` at a distance [m] from both edges, shape ``(1, 2)``."""
        return np.full((1, 2), float(distance))

    def kept_at_samples(self, kept: Array, limits: TwistLimits, period: float) -> Array:  # noqa: ARG002
        """The same with the inter-sample margin of all arcs; see `FreeSpace.tightened`."""
        return kept

    def kept_for(self, kept: Array, twists: Array, period: float) -> Array:  # noqa: ARG002
        """The same for the arcs of one plan, ``(N + 1, 2)``; see `FreeSpace.for_samples_of`."""
        return kept

    def space(self, distance: float) -> RoadSpace:
        """The road at a distance [m] from both edges, for compiled code."""
        return self._space._replace(kept=self.kept(distance))

    @classmethod
    def load(cls) -> None:
        """Compile or load its functions."""
        addresses(*cls.functions)

    @cached_property
    def _space(self) -> RoadSpace:
        functions = addresses(*self.functions)
        return RoadSpace(functions, self.numbers, self.table, np.zeros(7), self.kept(0.0))

    def __getstate__(self) -> dict[str, Any]:
        """Without addresses, which another process does not have."""
        return {key: value for key, value in self.__dict__.items() if key != '_space'}

    def edges(self) -> list[Array]:
        """Both edges, if there are any, in any order, each of shape ``(K, 2)`` [m]."""
        return []

    def center_line(self) -> Array:
        """The centre line, if there is one, shape ``(K, 2)`` [m]."""
        return np.empty((0, 2))

    def area(self) -> Array:
        """The road as one polygon, which winds round twice where it crosses itself, ``(K, 2)``."""
        first, second = self.edges() or [np.empty((0, 2))] * 2
        return np.vstack([first, second[::-1]])

    def middle(self) -> Array:
        """A pose in the middle of the road, along it, shape ``(3,)`` [m, m, rad]."""
        return np.zeros(3)

    def beside(self) -> Array:
        """A pose that is not on this part of the road, shape ``(3,)`` [m, m, rad]."""
        return np.array([1.0, 0.0, 0.0])

    def beyond(self, point: Point) -> float:  # noqa: ARG002
        """Distance of a point beyond an end of the road, 0 where it is not [m]."""
        return 0.0

    def shortest_length(self, start: Point, goal: Point, distance: float = 0.0) -> float:  # noqa: ARG002
        """A length that no path is shorter than that keeps the distance from both edges [m]."""
        return math.dist(start, goal)


@inner
def _no_edges(road: RoadSpace, _k: int, _x: float, _y: float, _at: float) -> None:
    road.found[0], road.found[1], road.found[2], road.found[3] = 0.0, 0.0, -math.inf, -math.inf


@inner
def _no_gradients(road: RoadSpace, _x: float, _y: float, _at: float) -> None:
    for i in range(7):
        road.found[i] = 0.0


@inner
def _far_from_edges(
    road: RoadSpace, arc: Arc, _at: float, _enough: float, _enough_other: float
) -> None:
    # NaN if the arc's end is.
    road.found[0], road.found[1] = 0.0, FAR + 0.0 * (arc.end_x + arc.end_y)
    road.found[2] = road.found[1]


@inner
def _straight_length(
    road: RoadSpace, x: float, y: float, _at: float, goal_x: float, goal_y: float, _goal: float
) -> None:
    road.found[0] = math.hypot(goal_x - x, goal_y - y)


@inner
def _straight_ahead(
    road: RoadSpace, x: float, y: float, _progress: float, way: float, to: Any
) -> None:
    left = max(math.hypot(to[0] - x, to[1] - y), 1e-9)
    road.found[0], road.found[1] = x + (to[0] - x) * (way / left), y + (to[1] - y) * (way / left)


@dataclass(frozen=True)
class OpenFloor(Road):
    """No road: neither edges nor a centre line."""

    edge_names: ClassVar[tuple[str, str]] = ('an edge', 'an edge')
    has_center_line: ClassVar[bool] = False
    functions: ClassVar = (
        no_progress, _no_edges, _no_gradients, _far_from_edges, _straight_length, _straight_ahead,
    )  # fmt: skip

    @property
    def numbers(self) -> Array:
        """None."""
        return np.zeros(1)

    @property
    def width(self) -> float:
        """Width of a picture around a path [m]."""
        return 2.0

    def kept(self, distance: float) -> Array:  # noqa: ARG002
        """Nothing."""
        return np.zeros((1, 2))


def arc_length_to(
    road: Road, pose: Array, goal: Point, heading: float | None = None, progress: float = math.nan
) -> float:
    """Arc length of the centre line from a pose to a goal, negative against its direction [m].

    The heading at the goal [rad] and the progress near the pose select the branch, if known.
    """
    return float(remaining_arc_length(road, pose[None], goal, heading, progress)[0])


def lookahead_point(
    road: Road, pose: Array, length: float, progress: float = math.nan
) -> tuple[Point, float]:
    """Point (x, y) [m] an arc length ahead of a pose, negative behind, and direction there."""
    x, y, direction = _ahead(road.space(0.0), pose[0], pose[1], pose[2], length, float(progress))
    return (x, y), direction


def lookahead_points(
    road: Road, pose: Array, lengths: Array, goal: Point, progress: float = math.nan
) -> Array:
    """Points ``(K, 2)`` [m] of the centre line, or on open floor of the line to the goal."""
    points = np.empty((len(lengths), 2))
    _fill_points(points, road.space(0.0), pose, lengths, goal, float(progress))
    return points


def project_on_path(road: Road, pose: Array, before: float) -> float:
    """Arc length of a pose, on the branch of the road along which the robot has come.

    `before` is its last value, NaN at first; NaN for roads that cannot cross themselves.
    """
    if not road.has_progress:
        return math.nan
    far = _BEYOND * road.width
    return find_near(road.space(0.0), pose[0], pose[1], pose[2], float(before), far)


def remaining_arc_length(
    road: Road, poses: Array, goal: Point, heading: float | None, progress: float = math.nan
) -> Array:
    """Arc lengths ``(K,)`` from each pose of a path to the goal, negative behind it [m]."""
    lengths = np.empty(len(poses))
    there = math.nan if heading is None else heading
    place = float(goal[0]), float(goal[1])
    _fill_remaining(lengths, road.space(0.0), poses, place, float(there), float(progress))
    return lengths


@allocation_free
def find_near(
    road: RoadSpace, x: float, y: float, heading: float, before: float, far: float
) -> float:
    """Arc length of a pose near the last place, or anywhere if it is too far beside that [m]."""
    place: float = road_functions.project(road, x, y, heading, before)
    _, _, over, over_other = road_functions.lateral_error(road, 0, x, y, place)
    if max(over, over_other) > far:
        place = road_functions.project(road, x, y, heading, math.nan)
    return place


@allocation_free
def _ahead(road: RoadSpace, x: float, y: float, heading: float, way: float, progress: float) -> Any:
    here = road_functions.project(road, x, y, heading, progress)
    at_x, at_y = road_functions.point_ahead(road, x, y, here, way, (x, y))
    before_x, before_y = road_functions.point_ahead(road, x, y, here, 0.999 * way, (x, y))
    along = math.atan2(at_y - before_y, at_x - before_x)
    there = road_functions.project(road, at_x, at_y, along, here + way)
    across_x, across_y, _, _, _, _, _ = road_functions.gradients(road, at_x, at_y, there)
    # Along the road, in the sense in which it is driven.
    along_x, along_y = across_y, -across_x
    if along_x * (at_x - before_x) + along_y * (at_y - before_y) < 0.0:
        along_x, along_y = -along_x, -along_y
    return at_x, at_y, math.atan2(along_y, along_x)


@allocation_free
def _fill_points(
    points: Array, road: RoadSpace, pose: Array, lengths: Array, goal: Point, progress: float
) -> None:
    x, y = pose[0], pose[1]
    here = road_functions.project(road, x, y, pose[2], progress)
    for k in range(lengths.shape[0]):
        points[k, 0], points[k, 1] = road_functions.point_ahead(road, x, y, here, lengths[k], goal)


@allocation_free
def _fill_remaining(
    lengths: Array, road: RoadSpace, poses: Array, goal: Point, heading: float, progress: float
) -> None:
    here = road_functions.project(road, poses[0, 0], poses[0, 1], poses[0, 2], progress)
    at_goal = road_functions.project(road, goal[0], goal[1], heading, math.nan)
    for k in range(poses.shape[0]):
        x, y = poses[k, 0], poses[k, 1]
        if k > 0:
            here = road_functions.lateral_error(road, 0, x, y, here)[0]
        lengths[k] = road_functions.arc_length_to(road, x, y, here, goal[0], goal[1], at_goal)
