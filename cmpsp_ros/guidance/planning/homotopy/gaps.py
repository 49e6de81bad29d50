"""The search for gaps that connect, between obstacles, from station to station along the road."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from cmpsp_ros.guidance.planning.homotopy.free_gaps import Gap
from cmpsp_ros.guidance.planning.homotopy.road_frame import SPACING, RoadFrame

HomotopyClass = tuple[int, ...]
"""For each obstacle: on which side it is passed, 1 or -1; 0 for not at all."""

# Choices followed at a time while searching: all of five obstacles in a row.
_BEAM = 32


@dataclass(frozen=True)
class Trail:
    """A choice of gaps, one a stretch, and its cost."""

    sides: HomotopyClass
    gaps: tuple[Gap, ...]
    position: float
    cost: float


@dataclass(frozen=True)
class Stretch:
    """Stations that follow each other, all with the same gaps.

    Attributes:
        gaps: Of each of them.
        stations: How many there are.
        passed: Obstacles whose centres lie beside them.
    """

    gaps: Sequence[Gap]
    stations: int
    passed: Sequence[int]


def stretches_of(
    frame: RoadFrame, gaps: Sequence[Sequence[Gap]], at: Sequence[float]
) -> list[Stretch]:
    """The stations, the first and the last alone with the gap that a plan begins or ends in.

    Args:
        frame: Road coordinates.
        gaps: Of each station, by their lateral positions [m].
        at: Stations of the obstacles' centres.
    """
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
    """All choices from beginning to end, of which the cheapest `_BEAM` are followed at a time.

    Args:
        frame: Road coordinates.
        stretches: As `stretches_of` gives them.
        lateral: Lateral positions of the obstacles' centres [m].

    Returns:
        The cheapest trail of each class.
    """
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
    """The gap that a place is in; those beside it where it is in none."""
    within = [gap for gap in gaps if gap[0] <= position <= gap[1]]
    if within:
        return within[:1]
    below = [gap for gap in gaps if gap[1] < position]
    above = [gap for gap in gaps if gap[0] > position]
    return [*below[-1:], *above[:1]]
