"""Free space of a robot's discs: the road shrunk and the obstacles grown by their distance."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.robots.motion import REFERENCE_POINT, arc_of_point, arc_under, point_of
from cmpsp_ros.world.grids.field_functions import NO_FIELD, Fields
from cmpsp_ros.world.grids.grid_obstacle import GridObstacle
from cmpsp_ros.world.inter_sample_margin import at_ends, outside, outside_known
from cmpsp_ros.world.obstacles.shape_functions import ShapeData, distance_from, sweep
from cmpsp_ros.world.obstacles.shapes import Shape
from cmpsp_ros.world.roads import Annulus, Road, road_functions
from cmpsp_ros.world.roads.road_functions import RoadSpace

# Between two arcs [m]; beyond it the second has nothing to do with where on the road the first was.
_JUMP = 0.1


class AnnulusLimits(NamedTuple):
    """Bounds ``(K,)`` of the distance from the centre of both circles, for all stages or each."""

    center: Array
    center_radius: float
    inner: Array
    outer: Array


class SpaceData(NamedTuple):
    """A free space for compiled code."""

    road: RoadSpace  # where on it the centre of a disc of the robot may be
    shapes: ShapeData
    radii: Array  # least distances from the shapes, ``-inf`` for none, shape ``(K, M)`` [m]
    discs: Array  # centres of the robot's discs, in its frame, shape ``(D, 2)`` [m]


@dataclass(frozen=True)
class FreeSpace:
    """A road with convex shapes taken out of it; all of it may change along a horizon.

    A shape is all that is nearer than a radius to a point, a line or a polygon, given by its
    corners; see `cmpsp_ros.world.obstacles.shape_functions`.
    """

    of_road: Road
    road: RoadSpace  # where on it the centre of a disc may be
    corners: Array  # of all shapes in a row, ``(K, C, 2)`` [m]; ``K`` is 1 where they stand still
    first: IntArray  # where the corners of each shape begin, and the last end, ``(M + 1,)``
    radii: Array  # of the shapes, ``(M,)`` or ``(K, M)`` [m]
    grids: tuple[GridObstacle, ...] = ()  # shapes of a distance field, two at most
    discs: Array = field(default_factory=REFERENCE_POINT.copy)  # as in `SpaceData`

    @classmethod
    def of(
        cls, road: Road, obstacles: Sequence[Shape], distance: float, discs: Array = REFERENCE_POINT
    ) -> FreeSpace:
        """Space whose every point is at least ``distance`` [m] from road edges and obstacles."""
        corners = [corner for obstacle in obstacles for corner in obstacle.corners]
        counts = [len(obstacle.corners) for obstacle in obstacles]
        return cls(
            road,
            road.space(distance),
            np.array(corners, dtype=float).reshape(1, -1, 2),
            np.array([0, *counts], dtype=np.int64).cumsum(),
            np.array([obstacle.radius + distance for obstacle in obstacles], dtype=float),
            tuple(each for each in obstacles if isinstance(each, GridObstacle)),
            discs,
        )

    @property
    def centers(self) -> Array:
        """Centres of the shapes at first, NaN for one without corners, shape ``(M, 2)`` [m]."""
        if self._are_points:
            return np.asarray(self.corners[0])
        parts = self._parts
        return np.array([(part.min(axis=0) + part.max(axis=0)) / 2.0 for part in parts])

    @property
    def landmarks(self) -> Array:
        """Points that a path passes on one side or the other, shape ``(M + I, 2)`` [m]."""
        return np.concatenate([self.centers, self.islands])

    @property
    def islands(self) -> Array:
        """Islands of all grids, see `GridObstacle.islands`."""
        return np.concatenate([np.empty((0, 2)), *(each.islands for each in self.grids)])

    @property
    def fields(self) -> Fields:
        """Fields of the grids, and ones that are never used where there are none."""
        first, second, *_ = *(each.field for each in self.grids), NO_FIELD, NO_FIELD
        return first, second

    @cached_property
    def data(self) -> SpaceData:
        """The space for compiled code."""
        shapes = ShapeData(self.fields, np.ascontiguousarray(self.corners), self.first)
        return SpaceData(self.road, shapes, np.atleast_2d(self.radii), self.discs)

    @property
    def reaches(self) -> Array:
        """Greatest distance of the corners of each shape from their centre, shape ``(M,)`` [m]."""
        if self._are_points:
            return np.zeros(len(self.first) - 1)
        parts = zip(self._parts, self.centers, strict=True)
        return np.array([np.hypot(*(part - center).T).max() for part, center in parts])

    @property
    def _are_points(self) -> bool:
        return bool((np.diff(self.first) == 1).all())

    @property
    def _parts(self) -> list[Array]:
        """Corners of each shape, as at first, each of shape ``(C, 2)`` [m]."""
        parts = np.split(self.corners[0], self.first[1:-1])
        return [part if len(part) else np.full((1, 2), math.nan) for part in parts]

    @property
    def annulus(self) -> AnnulusLimits:
        """Limits of the road between two circles; ValueError for a road of another kind."""
        road, kept = self.of_road, self.road.kept
        if not isinstance(road, Annulus):
            raise ValueError('road: found another kind, wanted an annulus')  # noqa: TRY004
        return AnnulusLimits(np.array(road.center), road.center_radius, kept[:, 1], kept[:, 0])

    def tightened(self, limits: TwistLimits, period: float) -> FreeSpace:
        """Space to keep to at samples so that any arcs between them stay in this one."""
        grown = np.array([outside(radius, limits, period) for radius in self.radii.tolist()])
        kept = self.of_road.kept_at_samples(self.road.kept, limits, period)
        return replace(self, road=self.road._replace(kept=kept), radii=grown)

    def for_samples_of(self, twists: Array, period: float) -> FreeSpace:
        """Space for samples of one plan, with arcs of twists ``(N, 2)`` [m/s, rad/s]."""
        return replace(
            self,
            road=self.road._replace(kept=self.of_road.kept_for(self.road.kept, twists, period)),
            radii=at_ends(np.maximum, outside_known(self.radii, twists, period)),
        )

    def with_some(self, samples: BoolArray, of: FreeSpace) -> FreeSpace:
        """This space, but at some samples ``(N + 1,)`` another one of the same things."""
        return replace(
            self,
            road=self.road.with_some(samples, of.road),
            radii=np.where(samples[:, None], of.radii, self.radii),
        )

    def with_points(self, centers: Array, radii: Array) -> FreeSpace:
        """This space without discs ``(K, D, 2)`` of radii ``(K, D)`` [m], a row each sample."""
        samples, added = radii.shape
        corners = np.broadcast_to(self.corners, (samples, *self.corners.shape[1:]))
        standing = np.broadcast_to(self.radii, (samples, len(self.first) - 1))
        more = self.first[-1] + np.arange(1, added + 1, dtype=np.int64)
        return replace(
            self,
            corners=np.concatenate([corners, centers], axis=1),
            first=np.concatenate([self.first, more]),
            radii=np.concatenate([standing, radii], axis=1),
        )

    def at(self, poses: Array, near: float = math.nan) -> Array:
        """Least clearance ``(K, 2 + M)`` of poses ``(K, 3)`` from both edges and each shape [m].

        `near` is the progress of a place near all poses, NaN if unknown [m].
        """
        found = np.empty((len(poses), 1 + len(self.first)))
        _fill_at(found, self.data, np.ascontiguousarray(poses), float(near))
        found[:, 2:] -= self.radii
        return found

    def along(self, poses: Array, twists: Array, durations: Array, near: float = math.nan) -> Array:
        """Least clearance of arcs from poses ``(K, 3)`` under twists for durations [s]; see `at`.

        Where the road crosses itself a path keeps to the branch that it is on.
        """
        found = np.empty((len(poses), 1 + len(self.first)))
        arcs = [np.ascontiguousarray(each) for each in (poses, twists, durations)]
        _fill_along(found, self.data, float(near), *arcs)
        found[:, 2:] -= self.radii
        return found


@allocation_free
def _fill_at(found: Array, space: SpaceData, poses: Array, near: float) -> None:
    road, shapes, discs = space.road, space.shapes, space.discs
    for k in range(poses.shape[0]):
        at = min(k, shapes.corners.shape[0] - 1)
        for i in range(discs.shape[0]):
            x, y = point_of(poses[k, 0], poses[k, 1], poses[k, 2], discs, i)
            place = road_functions.project(road, x, y, poses[k, 2], near)
            _, _, over, over_other = road_functions.lateral_error(road, k, x, y, place)
            _put_least(found, k, 0, i, min(-over, road_functions.FAR))
            _put_least(found, k, 1, i, min(-over_other, road_functions.FAR))
            for j in range(shapes.first.shape[0] - 1):
                distance = distance_from(shapes, at, j, x, y)
                _put_least(found, k, 2 + j, i, distance)


@allocation_free
def _fill_along(
    found: Array, space: SpaceData, near: float, poses: Array, twists: Array, times: Array
) -> None:
    road, shapes, discs = space.road, space.shapes, space.discs
    place, end_x, end_y = 0.0, math.nan, math.nan
    for k in range(poses.shape[0]):
        x, y, heading = poses[k, 0], poses[k, 1], poses[k, 2]
        if not math.hypot(x - end_x, y - end_y) <= _JUMP:
            place = road_functions.project(road, x, y, heading, near if k == 0 else math.nan)
        arc = arc_under(poses, twists, k, times[k])
        end_x, end_y, before = arc.end_x, arc.end_y, place
        for i in range(discs.shape[0]):
            driven = arc_of_point(arc, heading, discs, i)
            # Points after the first count only if they are nearer.
            bound, bound_other = (math.inf, math.inf) if i == 0 else (found[k, 0], found[k, 1])
            after, clearance, other = road_functions.sweep(road, driven, before, bound, bound_other)
            place = after if i == 0 else place
            _put_least(found, k, 0, i, clearance)
            _put_least(found, k, 1, i, other)
            for j in range(shapes.first.shape[0] - 1):
                bound = math.inf if i == 0 else found[k, 2 + j]
                least = sweep(driven, shapes, j, bound)
                _put_least(found, k, 2 + j, i, least)


@allocation_free
def _put_least(found: Array, k: int, column: int, i: int, clearance: float) -> None:
    """Put the clearance of a disc where none before has less; NaN stays."""
    if i == 0 or clearance < found[k, column] or math.isnan(clearance):
        found[k, column] = clearance
