"""Road coordinates from a pose to a goal, and paths in them as lateral positions at stations.

Between two circles, among discs, they are polar and exact: a station is the angle from the pose
[rad], a lateral position the distance from the centre [m]. Elsewhere they follow a line, straight
on open floor: a station is the arc length, a lateral position the distance to its left [m].
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.world.roads import Annulus, arc_length_to, lookahead_points

SPACING: Final = 0.2  # least distance of stations [m]
_MAX_STATIONS: Final = 400
_LEAST_STRETCH: Final = 0.05  # least distance of stations inside a bend, relative to the line
_PASSES: Final = 3
_RETURN: Final = 1.5  # length over which a path that was pushed aside returns [m]
_SWEEPS: Final = 40
_RELAXATION: Final = 1.6


class RoadFrame(NamedTuple):
    """Stations along the path from a pose to a goal."""

    stations: Array  # evenly spaced from 0, shape ``(K,)`` [rad or m]
    step: float  # distance of two stations [rad or m]
    length: float  # of the path [m]
    middle: float  # lateral position of the centre line [m]
    ends: tuple[float, float]  # lateral positions of the pose and of the goal [m]
    left: float  # 1 if lateral positions grow to the left, -1 if to the right
    polar: bool  # whether they are polar coordinates
    x: float  # centre of polar coordinates [m]
    y: float  # centre of polar coordinates [m]
    begin: float  # bearing of the pose from there [rad]
    side: float  # 1 anticlockwise, -1 clockwise
    points: Array  # points of the line at the stations ``(K, 2)`` [m]; none in polar coordinates
    directions: Array  # unit vectors along it there, shape ``(K, 2)``
    curvature: Array  # curvature of the line, positive to the left, shape ``(K,)`` [1/m]

    @property
    def spacing(self) -> float:
        """Distance of two stations on the centre line [m]."""
        return self.step * self.middle if self.polar else self.step

    def coordinates(self, points: Array) -> tuple[Array, Array]:
        """Stations and lateral positions of points, each of shape ``(M,)``."""
        if self.polar:
            offsets = points - (self.x, self.y)
            bearings = [math.atan2(y, x) - self.begin for x, y in offsets.tolist()]
            at = [self.side * (each - math.tau * round(each / math.tau)) for each in bearings]
            return np.array(at), np.array([math.hypot(x, y) for x, y in offsets.tolist()])
        away = points[:, None] - self.points
        nearest = np.argmin((away**2).sum(axis=2), axis=1)
        along, across = self.local(points, nearest)
        stretch = np.maximum(1.0 - self.curvature[nearest] * across, _LEAST_STRETCH)
        return self.stations[nearest] + along / stretch, across

    def local(self, points: Array, station: Any) -> tuple[Array, Array]:
        """Points along and across the line, from stations of it [m]."""
        away, directions = points - self.points[station], self.directions[station]
        along: Array = (away * directions).sum(axis=-1)
        across: Array = directions[..., 0] * away[..., 1] - directions[..., 1] * away[..., 0]
        return along, across


def road_frame(settings: LawSettings, start: PlanStart, target: Target) -> RoadFrame:
    """Coordinates of the road from the beginning of a plan to its target."""
    discs = all(each.is_disc for each in start.world.shapes)
    if discs and isinstance(start.world.road, Annulus):
        return _polar(start.world.annulus, start.pose, target.position)
    return _along_line(settings, start, target)


def _polar(road: Annulus, pose: Array, goal: tuple[float, float]) -> RoadFrame:
    nothing = np.zeros((1, 2))
    x, y = road.center
    begin = math.atan2(pose[1] - y, pose[0] - x)
    total = math.remainder(math.atan2(goal[1] - y, goal[0] - x) - begin, math.tau)
    length, side = abs(total) * road.center_radius, math.copysign(1.0, total)
    stations = np.linspace(0.0, abs(total), _count(length))
    ends = math.dist(pose[:2], road.center), math.dist(goal, road.center)
    return RoadFrame(
        stations, stations.item(1), length, road.center_radius, ends, -side,
        True, x, y, begin, side, nothing, nothing, np.zeros(1),
    )  # fmt: skip


def _along_line(settings: LawSettings, start: PlanStart, target: Target) -> RoadFrame:
    goal, pose = target.position, np.ascontiguousarray(start.pose, dtype=np.float64)
    total = arc_length_to(start.world.road, pose, goal, target.heading, start.progress)
    search = start.world.map_search(settings)
    if search is not None and len(points := search.line(pose[:2], goal, SPACING)) > 1:
        return frame_along(points)
    length = max(abs(total), SPACING)
    stations = np.linspace(0.0, length, _count(length))
    lengths = np.copysign(stations, total)
    frame = frame_along(lookahead_points(start.world.road, pose, lengths, goal, start.progress))
    _, ends = frame.local(np.array([pose[:2], goal]), np.array([0, -1]))
    return frame._replace(length=abs(total), ends=(float(ends[0]), float(ends[1])))


def frame_along(points: Array) -> RoadFrame:
    """Coordinates of a line, from points at even distances, shape ``(K, 2)`` [m]."""
    length = float(np.hypot(*np.diff(points, axis=0).T).sum())
    stations = np.linspace(0.0, max(length, SPACING), len(points))
    directions = np.gradient(points, axis=0)
    directions /= np.maximum(np.hypot(*directions.T), 1e-9)[:, None]
    headings, step = np.unwrap(np.arctan2(directions[:, 1], directions[:, 0])), stations.item(1)
    return RoadFrame(
        stations, step, length, 0.0, (0.0, 0.0), 1.0,
        False, 0.0, 0.0, 0.0, 1.0, points, directions, np.gradient(headings, step),
    )  # fmt: skip


def _count(length: float) -> int:
    """Number of stations, two at least."""
    return min(max(math.ceil(length / SPACING), 1), _MAX_STATIONS) + 1


@allocation_free
def locate(frame: RoadFrame, x: float, y: float, at: float, bearing: float) -> Any:
    """Station, lateral position [m] and bearing [rad] of a point, from those of one nearby."""
    if frame.polar:
        now = math.atan2(y - frame.y, x - frame.x)
        lateral = math.hypot(x - frame.x, y - frame.y)
        return at + frame.side * wrapped(now - bearing), lateral, now
    last, lateral = frame.stations.shape[0] - 1, 0.0
    for _ in range(_PASSES):
        k = int(min(max(at / frame.step + 0.5, 0.0), last + 0.0))
        dx, dy = x - frame.points[k, 0], y - frame.points[k, 1]
        cosine, sine = frame.directions[k, 0], frame.directions[k, 1]
        lateral = cosine * dy - sine * dx
        stretch = max(1.0 - frame.curvature[k] * lateral, _LEAST_STRETCH)
        at = k * frame.step + (cosine * dx + sine * dy) / stretch
    return at, lateral, bearing


@allocation_free
def point_at(frame: RoadFrame, at: float, lateral: float) -> Any:
    """Point (x, y) at a station, or between two, and a lateral position [m]."""
    if frame.polar:
        bearing = frame.begin + frame.side * at
        return frame.x + lateral * math.cos(bearing), frame.y + lateral * math.sin(bearing)
    place = at / frame.step
    k = int(min(max(place, 0.0), frame.stations.shape[0] - 2.0))
    part = place - k
    cosine = (1.0 - part) * frame.directions[k, 0] + part * frame.directions[k + 1, 0]
    sine = (1.0 - part) * frame.directions[k, 1] + part * frame.directions[k + 1, 1]
    size = max(math.hypot(cosine, sine), 1e-9)
    x = (1.0 - part) * frame.points[k, 0] + part * frame.points[k + 1, 0]
    y = (1.0 - part) * frame.points[k, 1] + part * frame.points[k + 1, 1]
    return x - lateral * sine / size, y + lateral * cosine / size


@allocation_free
def stretch_at(frame: RoadFrame, at: float, lateral: float) -> float:
    """Length of a path along the road per unit of stations [m or 1]."""
    if frame.polar:
        return lateral
    k = int(min(max(at / frame.step + 0.5, 0.0), frame.stations.shape[0] - 1.0))
    stretch: float = 1.0 - frame.curvature[k] * lateral
    return stretch


@allocation_free
def wrapped(angle: float) -> float:
    """An angle wrapped to the range from ``-pi`` to ``pi`` [rad]."""
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))


def elastic_band(frame: RoadFrame, low: Array, high: Array, ends: tuple[float, float]) -> Array:
    """Elastic bands ``(W, K)`` between bounds, drawn to the centre line, by over-relaxation [m]."""
    profiles: Array = np.clip(np.full_like(low, frame.middle), low, high)
    profiles[:, 0], profiles[:, -1] = ends
    pull = np.full(len(frame.stations), (frame.spacing / _RETURN) ** 2)
    _relax(profiles, low, high, pull, pull * frame.middle)
    return profiles


def shortest_path(frame: RoadFrame, low: Array, high: Array, ends: tuple[float, float]) -> Array:
    """Shortest paths between bounds; arguments and result as in `elastic_band`.

    To first order in its angle to the road a straight line has ``r'' = r`` in polar coordinates,
    and ``e'' = c^2 e - c`` beside a line of curvature ``c``.
    """
    profiles = low.copy() if frame.polar else np.clip(np.zeros_like(low), low, high)
    profiles[:, 0], profiles[:, -1] = ends
    if frame.polar:
        pull, drift = np.full(len(frame.stations), frame.step**2), np.zeros(len(frame.stations))
    else:
        pull, drift = (frame.curvature * frame.step) ** 2, frame.curvature * frame.step**2
    _relax(profiles, low, high, pull, drift)
    return profiles


@allocation_free
def _relax(profiles: Array, low: Array, high: Array, pull: Array, drift: Array) -> None:
    for path in range(profiles.shape[0]):
        for sweep in range(2 * _SWEEPS):
            for k in range(1 + sweep % 2, profiles.shape[1] - 1, 2):
                here = profiles[path, k]
                wanted = profiles[path, k - 1] + profiles[path, k + 1] + drift[k]
                moved = here + _RELAXATION * (wanted / (2.0 + pull[k]) - here)
                profiles[path, k] = min(max(moved, low[path, k]), high[path, k])


def lengths(frame: RoadFrame, profile: Array) -> Array:
    """Lengths ``(..., K - 1)`` between stations of paths at lateral positions ``(..., K)`` [m]."""
    along = (profile[..., 1:] + profile[..., :-1]) / 2.0
    if not frame.polar:
        along = 1.0 - (frame.curvature[1:] + frame.curvature[:-1]) / 2.0 * along
    pieces: Array = np.hypot(np.diff(profile), along * frame.step)
    return pieces
