"""The search for gaps that connect, between obstacles, from station to station along the road."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Gap = tuple[float, float]

HomotopyClass = tuple[int, ...]
"""For each obstacle: on which side it is passed, 1 or -1; 0 for not at all."""

SPACING: Final = 0.2
"""Of the stations, at least [m]."""

# Choices followed at a time while searching: all of five obstacles in a row.
_BEAM = 32


@dataclass(frozen=True)
class Disc:
    """A grown obstacle, seen along the road: angle from the beginning, distance, radius."""

    at: float
    distance: float
    radius: float


@dataclass(frozen=True)
class Trail:
    """A choice of gaps, one a stretch, and its cost."""

    sides: HomotopyClass
    gaps: tuple[Gap, ...]
    radius: float
    cost: float


@dataclass(frozen=True)
class Stretch:
    """Stations that follow each other, all with the same gaps.

    Attributes:
        gaps: Of each of them.
        stations: How many there are.
        passed: Discs whose centres lie beside them.
    """

    gaps: Sequence[Gap]
    stations: int
    passed: Sequence[int]


def free(
    discs: Sequence[Disc], turned: Array, inner: float, outer: float
) -> list[list[tuple[float, float]]]:
    """Gaps at every station, from the road's inner edge outwards [m].

    A station stands for the way to half the distance of its neighbours, so that no disc is between
    two of them.

    Args:
        discs: The obstacles.
        turned: Angles of the stations from the beginning, evenly apart, shape ``(K,)`` [rad].
        inner: Least distance from the road's centre [m].
        outer: Greatest distance from it [m].
    """
    half = turned[1] / 2.0
    gaps = []
    for station in turned.tolist():
        taken = []
        for disc in discs:
            off = max(abs(station - disc.at) - half, 0.0)
            across = disc.distance * math.sin(min(off, math.pi / 2.0))
            if across < disc.radius and off < math.pi / 2.0:
                along, reach = disc.distance * math.cos(off), math.sqrt(disc.radius**2 - across**2)
                taken.append((along - reach, along + reach))
        gaps.append(_between(sorted(taken), inner, outer))
    return gaps


def _between(taken: Sequence[Gap], inner: float, outer: float) -> list[Gap]:
    gaps, edge = [], inner
    for low, high in taken:
        if low > edge:
            gaps.append((edge, min(low, outer)))
        edge = max(edge, high)
        if edge >= outer:
            return gaps
    return [*gaps, (edge, outer)] if outer > edge else gaps


def stretches_of(
    gaps: Sequence[Sequence[Gap]], discs: Sequence[Disc], turned: Array, ends: Gap
) -> list[Stretch]:
    """The stations, the first and the last alone with the gap that a plan begins or ends in.

    Args:
        gaps: Of each station, as `free` gives them [m].
        discs: What is passed.
        turned: Angles of the stations, shape ``(K,)`` [rad].
        ends: Distances from the road's centre at which paths begin and end [m].
    """
    places: dict[int, list[int]] = {}
    for index, disc in enumerate(discs):
        if 0.0 < disc.at <= turned[-1]:
            places.setdefault(round(disc.at / turned[1]), []).append(index)
    found = [Stretch(_reached(gaps[0], ends[0]), 1, ())]
    for station, here in enumerate(gaps[1:-1], 1):
        passed, before = places.get(station, ()), found[-1]
        if station > 1 and here == before.gaps and not passed and not before.passed:
            found[-1] = Stretch(here, before.stations + 1, ())
        else:
            found.append(Stretch(here, 1, passed))
    return [*found, Stretch(_reached(gaps[-1], ends[1]), 1, places.get(len(gaps) - 1, ()))]


def search(
    stretches: Sequence[Stretch], discs: Sequence[Disc], begin: float, middle: float
) -> list[Trail]:
    """All choices from beginning to end, of which the cheapest `_BEAM` are followed at a time.

    Args:
        stretches: As `stretches_of` gives them.
        discs: What is passed.
        begin: Distance from the road's centre at the beginning [m].
        middle: Radius of the centre line [m].

    Returns:
        The cheapest trail of each class; its sides are inner and outer, not left and right.
    """
    trails = [Trail((0,) * len(discs), (gap,), begin, 0.0) for gap in stretches[0].gaps]
    for stretch in stretches[1:]:
        found: dict[tuple[HomotopyClass, Gap], Trail] = {}
        for trail in trails:
            low, high = trail.gaps[-1]
            for gap in stretch.gaps:
                if min(high, gap[1]) <= max(low, gap[0]):
                    continue
                longer = _longer(trail, gap, stretch, discs, middle)
                known = found.get((longer.sides, gap))
                if known is None or longer.cost < known.cost:
                    found[longer.sides, gap] = longer
        trails = sorted(found.values(), key=lambda each: (each.cost, each.sides))[:_BEAM]
    best: dict[HomotopyClass, Trail] = {}
    for trail in trails:
        best.setdefault(trail.sides, trail)
    return list(best.values())


def _longer(
    trail: Trail, gap: Gap, stretch: Stretch, discs: Sequence[Disc], middle: float
) -> Trail:
    radius = min(max(middle, gap[0]), gap[1])
    off = (radius - middle) ** 2 * SPACING * stretch.stations
    cost = trail.cost + off + abs(radius - trail.radius)
    passed = trail.sides
    if stretch.passed:
        sides = list(passed)
        for index in stretch.passed:
            sides[index] = 1 if (gap[0] + gap[1]) / 2.0 > discs[index].distance else -1
        passed = tuple(sides)
    return Trail(passed, (*trail.gaps, gap), radius, cost)


def _reached(gaps: Sequence[Gap], radius: float) -> Sequence[Gap]:
    """The gap that a place is in; those beside it where it is in none."""
    within = [gap for gap in gaps if gap[0] <= radius <= gap[1]]
    if within:
        return within[:1]
    below = [gap for gap in gaps if gap[1] < radius]
    above = [gap for gap in gaps if gap[0] > radius]
    return [*below[-1:], *above[:1]]
