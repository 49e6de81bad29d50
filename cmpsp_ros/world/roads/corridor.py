"""The road along a centre line that is given by points."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.world.inter_sample_margin import at_ends, bent_edge_margin, bent_edge_margin_known
from cmpsp_ros.world.roads import corridor_functions as compiled
from cmpsp_ros.world.roads.center_line import CenterLine, Samples, fit, sample
from cmpsp_ros.world.roads.road import Point, Road

_CLOSE = 1e-6
_SHARPEST_TURN = math.radians(120.0)

# Part of the radius of curvature that must be left beyond the edge on the inner side of a curve.
_LEFT_OF_RADIUS = 0.1

# Stations of the first search in a width, or in a radius of curvature.
_IN_A_WIDTH = 4.0
_MOST_STATIONS = 20_000

# Factor by which bounds from samples may be short.
_BETWEEN_SAMPLES = 1.05


class RoadError(ValueError):
    """A centre line that is none: number of the point, from 0, found and wanted."""

    def __init__(self, point: int, found: str, wanted: str) -> None:
        super().__init__(f'point {point}: found {found}, wanted {wanted}')
        self.point, self.found, self.wanted = point, found, wanted


@dataclass(frozen=True)
class Corridor(Road):
    """A smooth line through points (x, y), with a width to either side at each of them [m].

    An open road goes on straight beyond its ends; a closed one from the last point to the first.
    """

    edge_names: ClassVar[tuple[str, str]] = ('the left road edge', 'the right road edge')
    has_progress: ClassVar[bool] = True
    functions: ClassVar = compiled.FUNCTIONS

    points: tuple[tuple[float, float], ...]
    left: tuple[float, ...]
    right: tuple[float, ...]
    closed: bool = False

    def __post_init__(self) -> None:
        """Check the points; raises RoadError, which says which point."""
        self._check_points()
        for widths in (self.left, self.right):
            for point, width in enumerate(widths):
                if width <= 0.0:
                    raise RoadError(point, f'a width of {width:.9g} m', 'more than 0 m')
        self._check_curves()

    @cached_property
    def width(self) -> float:
        """From edge to edge where it is greatest [m]."""
        return max(map(sum, zip(self.left, self.right, strict=True)))

    @property
    def length(self) -> float:
        """Length of the centre line [m]."""
        return self._line.length

    @property
    def lap(self) -> float:
        """Length of a closed one [m]."""
        return self.length if self.closed else 0.0

    @property
    def clearance_scale(self) -> Array:
        """Less than 1 where the width changes, shape ``(2,)``."""
        return np.array([scale for scale, _ in self._bounds])

    def kept_at_samples(self, kept: Array, limits: TwistLimits, period: float) -> Array:
        """Bounds with the inter-sample margin, see `Road.kept_at_samples`."""
        margins = [bent_edge_margin(bend, limits, period) for _, bend in self._bounds]
        return np.asarray(kept + np.array([margins]))

    def kept_for(self, kept: Array, twists: Array, period: float) -> Array:
        """Bounds for the arcs of one plan, see `Road.kept_for`."""
        bends = np.array([bend for _, bend in self._bounds])
        return kept + at_ends(np.maximum, bent_edge_margin_known(bends, twists, period))

    def edges(self) -> list[Array]:
        """Both edges, the left first, each of shape ``(K, 2)`` [m]."""
        at = self._drawn
        return [
            np.column_stack([at.x - off * at.sine, at.y + off * at.cosine])
            for off in (at.widths[0, 0], -at.widths[1, 0])
        ]

    def center_line(self) -> Array:
        """The centre line, shape ``(K, 2)`` [m]."""
        return np.column_stack([self._drawn.x, self._drawn.y])

    def middle(self) -> Array:
        """A pose in the middle of the road, along it, shape ``(3,)`` [m, m, rad]."""
        at, half = self._samples, len(self._samples.x) // 2
        return np.array([at.x[half], at.y[half], math.atan2(at.sine[half], at.cosine[half])])

    def beside(self) -> Array:
        """A pose that is not on this part of the road, shape ``(3,)`` [m, m, rad]."""
        x, y, heading = self.middle()
        return np.array(
            [x - self.width * math.sin(heading), y + self.width * math.cos(heading), 0.0]
        )

    def beyond(self, point: tuple[float, float]) -> float:
        """Distance of a point beyond an end of the road, 0 where it is not [m]."""
        at = self._drawn
        if self.closed:
            return 0.0
        nearest = int(np.argmin((at.x - point[0]) ** 2 + (at.y - point[1]) ** 2))
        if nearest not in (0, len(at.x) - 1):
            return 0.0
        along = (point[0] - at.x[nearest]) * at.cosine[nearest]
        along += (point[1] - at.y[nearest]) * at.sine[nearest]
        return max(0.0, float(-along if nearest == 0 else along))

    def shortest_length(self, start: Point, goal: Point, distance: float = 0.0) -> float:
        """Along the inner edges of all curves from start to goal, by the shorter way or branch."""
        at, step = self._samples, np.diff(self._samples.progress, append=self.length)
        beside = np.maximum(self._inside - distance * np.abs(at.curvature), 0.0)
        driven = np.cumsum(step * (1.0 - beside)) - step
        here, there = (driven[self._nearest(each)] for each in (start, goal))
        lengths = np.abs(here[:, None] - there)
        if self.closed:
            lengths = np.minimum(lengths, float(driven[-1]) - lengths)
        # Start and goal are beside points between two samples.
        return max(float(lengths.min() - 2.0 * step.max()), math.dist(start, goal))

    def _nearest(self, point: Point) -> IntArray:
        """Numbers of the samples that are nearest to a point, one for each part of the road."""
        away = np.hypot(self._samples.x - point[0], self._samples.y - point[1])
        before, after = np.roll(away, 1), np.roll(away, -1)
        if not self.closed:
            before[0] = after[-1] = math.inf
        nearest = (away <= before) & (away <= after) & (away <= self.width)
        nearest[away.argmin()] = True
        return np.flatnonzero(nearest)

    @cached_property
    def _line(self) -> CenterLine:
        arrays = (np.array(each, dtype=float) for each in (self.points, self.left, self.right))
        return fit(*arrays, closed=self.closed)

    @cached_property
    def _samples(self) -> Samples:
        return sample(self._line, closed=self.closed)

    @cached_property
    def _drawn(self) -> Samples:
        """The samples with the end of the road."""
        at = self._samples
        if self.closed:
            return Samples(*(np.concatenate([each, each[..., :1]], axis=-1) for each in at))
        line = self._line
        # An extension beyond the end begins where the road ends.
        end = sample(CenterLine(line.knots[-2:], line.pieces[-1:], line.length), closed=True)
        both = zip(at, end, strict=True)
        return Samples(*(np.concatenate([a, b[..., :1]], axis=-1) for a, b in both))

    @cached_property
    def numbers(self) -> Array:
        """Scalars and stations, see `corridor_functions`."""
        line, at = self._line, self._samples
        radius = 1.0 / max(float(np.abs(at.curvature).max()), 1e-9)
        spacing = min(float(at.widths[:, 0].min()), radius) / _IN_A_WIDTH
        count = min(max(math.ceil(line.length / spacing), 2), _MOST_STATIONS)
        places = np.arange(count) * (line.length / count)
        x, y = (np.interp(places, at.progress, each) for each in (at.x, at.y))
        heading = np.interp(places, at.progress, np.unwrap(np.arctan2(at.sine, at.cosine)))
        scalars = np.zeros(compiled.N_SCALARS)
        scalars[compiled.LENGTH], scalars[compiled.CLOSED] = line.length, self.closed
        scalars[compiled.STRIDE], scalars[compiled.ROOM] = radius / 2.0, self._room
        scalars[compiled.DECIDES] = float(at.widths[:, 0].max())
        scalars[compiled.STATION_STEP] = line.length / count
        scalars[compiled.CELLS_IN_METRE] = len(line.pieces) / float(line.knots[-1] - line.knots[0])
        scalars[[compiled.PART, compiled.PART_OTHER]] = self.clearance_scale
        scalars[[compiled.BEND, compiled.BEND_OTHER]] = [bend for _, bend in self._bounds]
        scalars[compiled.N_STATIONS] = count
        stations = np.column_stack([x, y, np.cos(heading), np.sin(heading)])
        return np.concatenate([scalars, stations.ravel()])

    @cached_property
    def table(self) -> Array:
        """Pieces of the centre line, see `corridor_functions`."""
        line = self._line
        cells = np.linspace(line.knots[0], line.knots[-1], len(line.pieces), endpoint=False)
        pieces = np.zeros((len(line.knots), compiled.PIECE))
        pieces[:, 0] = line.knots
        pieces[:-1, 1] = np.searchsorted(line.knots, cells, side='right') - 1
        pieces[:-1, 2:] = line.pieces
        return pieces

    @cached_property
    def _inside(self) -> Array:
        """Width on the inner side of a curve, in radii of curvature, shape ``(Z,)``."""
        curvature, (left, right) = self._samples.curvature, self._samples.widths[:, 0]
        return np.asarray(np.maximum(curvature * left, -curvature * right))

    @cached_property
    def _room(self) -> float:
        """Width around the road where projections are unique: at most halfway to a centre [m]."""
        at = self._samples
        left = (1.0 - self._inside) / np.maximum(np.abs(at.curvature), 1e-9)
        return min(float(left.min()) / 2.0, float(at.widths[:, 0].min()) / 4.0)

    @cached_property
    def _bounds(self) -> list[tuple[float, float]]:
        """Scale of a clearance from each edge, and its greatest second derivative [1/m].

        With the distance ``e`` to the left of the centre line and the curvature ``c`` the progress
        of a point changes ``q = 1 / (1 - c e)`` times as fast as the point moves along the road;
        that factor's gradient and the curvature bound the second derivative of ``width - e``.
        """
        at, bounds = self._samples, []
        furthest = at.widths[:, 0].max(axis=0) + self._room
        c = np.abs(at.curvature)
        q = 1.0 / np.maximum(1.0 - c * furthest, _LEFT_OF_RADIUS / 2.0)
        second = q**3 * np.abs(at.curvature_slope) * furthest + 2.0 * q**2 * c
        for widths in at.widths:
            _, slope, bend = np.abs(widths)
            steep = np.hypot(1.0, slope * q)
            total = _BETWEEN_SAMPLES * float((c * q + bend * q**2 + slope * second).max())
            scale = 1.0 / float(steep.max())
            bounds.append(
                (1.0, total) if scale == 1.0 else (scale / _BETWEEN_SAMPLES, total * scale)
            )
        return bounds

    def _check_points(self) -> None:
        least = 3 if self.closed else 2
        if len(self.points) < least:
            raise RoadError(
                len(self.points), 'the end of the list', f'{least} points or more in a road'
            )
        points = np.array([*self.points, self.points[0]] if self.closed else self.points)
        steps = np.diff(points, axis=0)
        for i, step in enumerate(np.hypot(*steps.T).tolist()):
            if step < _CLOSE:
                point = (i + 1) % len(self.points) or i
                raise RoadError(point, 'the same place as its neighbour', 'another')
        headings = np.arctan2(steps[:, 1], steps[:, 0])
        for i, turn in enumerate(np.diff(headings, append=headings[:1]).tolist()):
            point = (i + 1) % len(self.points)
            is_end = not self.closed and i == len(headings) - 1
            if not is_end and abs(math.remainder(turn, math.tau)) > _SHARPEST_TURN:
                found = (
                    f'a turn back by {math.degrees(abs(math.remainder(turn, math.tau))):.4g} deg'
                )
                wanted = 'points in order, with turns of 120 deg or less'
                raise RoadError(point, found, wanted)

    def _check_curves(self) -> None:
        at, inside = self._samples, self._inside
        worst = int(np.argmax(inside))
        if inside[worst] > 1.0 - _LEFT_OF_RADIUS:
            radius = 1.0 / abs(at.curvature[worst])
            width = inside[worst] * radius
            raise RoadError(
                int(at.point[worst]),
                f'a curve of radius {radius:.4g} m after it, and a width of {width:.4g} m inside',
                f'a width of at most {1.0 - _LEFT_OF_RADIUS:.2g} of the radius',
            )
