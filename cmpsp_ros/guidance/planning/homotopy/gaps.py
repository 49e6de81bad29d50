"""Gaps that edges and obstacles leave free of the road, and the trails that connect them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance.planning.homotopy.road_frame import SPACING, RoadFrame
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import DistanceField, field_functions
from cmpsp_ros.world.obstacles import outline_of
from cmpsp_ros.world.roads import RoadSpace, road_functions

Gap = tuple[float, float]  # lateral positions of both ends [m]
HomotopyClass = tuple[int, ...]  # side of each obstacle: 1 left of it, -1 right, 0 not passed
_ROUNDING: Final = 100.0  # gaps are rounded inwards to this: a road of one width has one [1/m]
_BESIDE: Final = 1.0  # free width beside all obstacles on open floor [m]
_ASIDE: Final = 2.0  # width searched beside the line and its ends, in the cells of a grid [m]
_TOO_FAR: Final = 0.9  # largest lateral position towards the centre of a bend, in its radius
_BEAM: Final = 32  # trails followed at a time while searching: all of five obstacles in a row


class Trail(NamedTuple):
    """A gap in each stretch, the side that it passes each obstacle on, and its cost [m^3]."""

    sides: HomotopyClass
    gaps: tuple[Gap, ...]
    position: float
    cost: float


class Stretch(NamedTuple):
    """A number of consecutive stations with the same gaps, and the obstacles centred there."""

    gaps: Sequence[Gap]
    stations: int
    passed: Sequence[int]


def between_samples(space: FreeSpace, straddled: float) -> FreeSpace:
    """Free space of the path between the samples of a plan: one for all stages, their median.

    `straddled` is the distance from the nearest sample at which a path may pass an obstacle [m].
    """
    radii = space.radii if space.radii.ndim == 1 else np.median(space.radii, axis=0)
    # Samples keep farther away than the path between them comes.
    radii = np.sqrt(np.maximum(radii**2 - straddled**2, 0.0)) * np.sign(radii)
    kept = np.median(space.road.kept, axis=0)[None]
    return replace(
        space, road=space.road._replace(kept=kept), corners=space.corners[:1], radii=radii
    )


def free_gaps(frame: RoadFrame, space: FreeSpace) -> tuple[list[list[Gap]], list[Gap]]:
    """Gaps at every station, and the road's edges there, in a space of `between_samples`.

    A station stands for half the distance to its neighbours, so that no obstacle is between two.
    """
    radii = space.radii
    if frame.polar:
        return _polar_gaps(frame, space)
    taken: list[list[Gap]] = [[] for _ in frame.stations]
    fields = iter(space.fields)
    shapes = np.split(space.corners[0], space.first[1:-1]) if len(radii) else []
    for corners, radius in zip(shapes, radii.tolist(), strict=True):
        found = (
            _sections(frame, corners, radius)
            if len(corners)
            else _in_field(frame, next(fields), radius)
        )
        for station, section in found:
            taken[station].append(section)
    edges = _edges(frame, space.road, taken)
    return [_between(sorted(each), *edge) for each, edge in zip(taken, edges, strict=True)], edges


def _polar_gaps(frame: RoadFrame, space: FreeSpace) -> tuple[list[list[Gap]], list[Gap]]:
    inner, outer = float(space.annulus.inner[0]), float(space.annulus.outer[0])
    # A moving disc is one, too.
    places = (each.tolist() for each in frame.coordinates(space.centers))
    discs = list(zip(*places, space.radii.tolist(), strict=True))
    half, gaps = frame.step / 2.0, []
    for station in frame.stations.tolist():
        taken = []
        for at, distance, radius in discs:
            off = max(abs(station - at) - half, 0.0)
            across = distance * math.sin(min(off, math.pi / 2.0))
            if across < radius and off < math.pi / 2.0:
                along, reach = distance * math.cos(off), math.sqrt(radius**2 - across**2)
                taken.append((along - reach, along + reach))
        gaps.append(_between(sorted(taken), inner, outer))
    return gaps, [(inner, outer)] * len(gaps)


def _sections(frame: RoadFrame, corners: Array, radius: float) -> Iterator[tuple[int, Gap]]:
    """Stations at which a rounded polygon lies, with the section that it occupies."""
    if not math.isfinite(radius):
        return
    line, half = outline_of(corners.tolist(), max(radius, 0.0)), frame.step / 2.0
    center = (line.min(axis=0) + line.max(axis=0)) / 2.0
    reach = float(np.hypot(*(line - center).T).max()) + half
    off, _ = frame.local(center, slice(None))
    near = np.flatnonzero(np.abs(off) <= reach)
    along, across = frame.local(line, near[:, None])
    for station, t, n in zip(near.tolist(), along, across, strict=True):
        inside = n[np.abs(t) <= half]
        cuts = [inside]
        for border in (-half, half):
            before, after = t[:-1] - border, t[1:] - border
            crossing = before * after < 0.0
            part = before[crossing] / (before[crossing] - after[crossing])
            cuts.append(n[:-1][crossing] + part * (n[1:][crossing] - n[:-1][crossing]))
        found = np.concatenate(cuts)
        if len(found):
            yield station, (float(found.min()), float(found.max()))


def _in_field(frame: RoadFrame, field: DistanceField, radius: float) -> Iterator[tuple[int, Gap]]:
    """Stations at which cells of a grid are occupied, with the sections that they occupy."""
    cell = float(field.frame['cell'][0])
    reach = max(map(abs, frame.ends)) + _ASIDE
    lateral = np.linspace(-reach, reach, 2 * math.ceil(reach / cell) + 1)
    blocked = np.zeros((len(frame.stations), len(lateral)), dtype=bool)
    fill_blocked(blocked, field, radius, frame, lateral)
    changes = np.diff(blocked.astype(np.int8), axis=1, prepend=0, append=0)
    half = (lateral[1] - lateral[0]) / 2.0
    for station in np.flatnonzero(blocked.any(axis=1)).tolist():
        begins, ends = np.flatnonzero(changes[station] > 0), np.flatnonzero(changes[station] < 0)
        for begin, end in zip(begins.tolist(), (ends - 1).tolist(), strict=True):
            yield station, (float(lateral[begin]) - half, float(lateral[end]) + half)


@allocation_free
def fill_blocked(
    blocked: BoolArray, field: DistanceField, radius: float, frame: RoadFrame, lateral: Array
) -> None:
    """Fill where a grid is nearer than a radius, anywhere around a station, ``(K, L)``."""
    count = math.ceil(frame.step / field.frame[0].cell)
    for k in range(blocked.shape[0]):
        cosine, sine = frame.directions[k, 0], frame.directions[k, 1]
        for j in range(blocked.shape[1]):
            # Beyond the centre of a bend the coordinates begin again.
            blocked[k, j] = frame.curvature[k] * lateral[j] > _TOO_FAR
            for i in range(count):
                along = ((i + 0.5) / count - 0.5) * frame.step
                x = frame.points[k, 0] + along * cosine - lateral[j] * sine
                y = frame.points[k, 1] + along * sine + lateral[j] * cosine
                if not field_functions.distance_from(field, x, y) >= radius:
                    blocked[k, j] = True
                    break


def _edges(frame: RoadFrame, road: RoadSpace, taken: Sequence[Sequence[Gap]]) -> list[Gap]:
    """Lateral positions of both edges at every station [m]."""
    bounds = np.empty((len(frame.stations), 2))
    _fill_bounds(bounds, road, frame.points, frame.directions)
    low, high = np.ceil(_ROUNDING * bounds[:, 0]), np.floor(_ROUNDING * bounds[:, 1])
    if not np.isfinite(bounds).all():
        reached = [abs(each) for section in taken for gap in section for each in gap]
        beside = max([*map(abs, frame.ends), *reached]) + _BESIDE
        low, high = np.full_like(low, -_ROUNDING * beside), np.full_like(high, _ROUNDING * beside)
    return list(zip((low / _ROUNDING).tolist(), (high / _ROUNDING).tolist(), strict=True))


@allocation_free
def _fill_bounds(bounds: Array, road: RoadSpace, points: Array, directions: Array) -> None:
    """Fill the bounds that the road's constraints, linear across it, set at a line's points."""
    for k in range(points.shape[0]):
        x, y = points[k, 0], points[k, 1]
        heading = math.atan2(directions[k, 1], directions[k, 0])
        progress = road_functions.project(road, x, y, heading, math.nan)
        progress, _, first, second = road_functions.lateral_error(road, 0, x, y, progress)
        _, _, _, first_x, first_y, second_x, second_y = road_functions.gradients(
            road, x, y, progress
        )
        across = directions[k, 0] * first_y - directions[k, 1] * first_x
        across_other = directions[k, 0] * second_y - directions[k, 1] * second_x
        bounds[k, 0], bounds[k, 1] = -math.inf, math.inf
        for value, slope in ((first, across), (second, across_other)):
            if slope > 0.0:
                bounds[k, 1] = min(bounds[k, 1], -value / slope)
            elif slope < 0.0:
                bounds[k, 0] = max(bounds[k, 0], -value / slope)


def _between(taken: Sequence[Gap], low: float, high: float) -> list[Gap]:
    gaps, edge = [], low
    for begin, end in taken:
        if begin > edge:
            gaps.append((edge, min(begin, high)))
        edge = max(edge, end)
        if edge >= high:
            return gaps
    return [*gaps, (edge, high)] if high > edge else gaps


def stretches_of(
    frame: RoadFrame, gaps: Sequence[Sequence[Gap]], at: Sequence[float]
) -> list[Stretch]:
    """Stretches of stations; the first and the last have the gap alone that a plan is in."""
    places: dict[int, list[int]] = {}
    for index, each in enumerate(at):
        if 0.0 < each <= frame.stations[-1]:
            places.setdefault(round(each / frame.step), []).append(index)
    found = [Stretch(_reached(gaps[0], frame.ends[0]), 1, ())]
    for station, here in enumerate(gaps[1:-1], 1):
        passed, before = places.get(station, ()), found[-1]
        if station > 1 and here == before.gaps and not passed and not before.passed:
            found[-1] = Stretch(here, before.stations + 1, ())
        else:
            found.append(Stretch(here, 1, passed))
    return [*found, Stretch(_reached(gaps[-1], frame.ends[1]), 1, places.get(len(gaps) - 1, ()))]


def search(frame: RoadFrame, stretches: Sequence[Stretch], lateral: Sequence[float]) -> list[Trail]:
    """The cheapest trail of each homotopy class, by a beam search; `lateral` of obstacles [m]."""
    nothing = (0,) * len(lateral)
    trails = [Trail(nothing, (gap,), frame.ends[0], 0.0) for gap in stretches[0].gaps]
    for stretch in stretches[1:]:
        found: dict[tuple[HomotopyClass, Gap], Trail] = {}
        for trail in trails:
            low, high = trail.gaps[-1]
            for gap in stretch.gaps:
                if min(high, gap[1]) <= max(low, gap[0]):
                    continue
                longer = _longer(frame, trail, gap, stretch, lateral)
                known = found.get((longer.sides, gap))
                if known is None or longer.cost < known.cost:
                    found[longer.sides, gap] = longer
        trails = sorted(found.values(), key=lambda each: (each.cost, each.sides))[:_BEAM]
    best: dict[HomotopyClass, Trail] = {}
    for trail in trails:
        best.setdefault(trail.sides, trail)
    return list(best.values())


def _longer(
    frame: RoadFrame, trail: Trail, gap: Gap, stretch: Stretch, lateral: Sequence[float]
) -> Trail:
    position = min(max(frame.middle, gap[0]), gap[1])
    off = (position - frame.middle) ** 2 * SPACING * stretch.stations
    cost = trail.cost + off + abs(position - trail.position)
    passed = trail.sides
    if stretch.passed:
        sides = list(passed)
        for index in stretch.passed:
            greater = (gap[0] + gap[1]) / 2.0 > lateral[index]
            sides[index] = int(frame.left if greater else -frame.left)
        passed = tuple(sides)
    return Trail(passed, (*trail.gaps, gap), position, cost)


def _reached(gaps: Sequence[Gap], position: float) -> Sequence[Gap]:
    """The gap at a position; those beside it where there is none."""
    within = [gap for gap in gaps if gap[0] <= position <= gap[1]]
    if within:
        return within[:1]
    below = [gap for gap in gaps if gap[1] < position]
    above = [gap for gap in gaps if gap[0] > position]
    return [*below[-1:], *above[:1]]
