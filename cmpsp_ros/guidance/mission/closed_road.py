"""A road that obstacles close, alone or together: the robot stops before them.

Each gap is a line from a corner of one obstacle to the next, or to the edge beside it; the true gap
is no wider. No robot crosses a chain of obstacles and gaps from edge to edge where every gap is too
narrow; and it must, where all of the chain lies between start and goal.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.approach import STANDSTILL, Approach, Contact
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import Point, Road, arc_length_to

_EDGES: Final = 2

_LONGEST: Final = 4.0
"""Widths of the road along which a chain may lie: where a road crosses itself, a longer one may lie
beside two parts of it."""

_SHORTEST = 0.5  # least part of the centre line's length that a way through bends has
_SOON = 3 * NANOSECONDS  # time that the robot may take to come nearer [ns]


@dataclass
class ClosedRoad:
    """Obstacles that close the road to the present goal, as far as it has been checked."""

    obstacles: frozenset[str] = frozenset()  # names of those that leave no passage between them
    goal: Point | None = None  # goal to which the road was checked (x, y) [m]; None for not at all
    wait_reason: str = ''  # reason to wait before them, a sentence; '' if none
    nearest: float = math.inf  # least distance from them so far [m]
    nearest_at: int = 0  # time of that [ns]

    def look(self, settings: LawSettings, start: PlanStart, target: Target) -> None:
        """Look whether the road is closed for the robot without its margin; once for each goal."""
        if self.obstacles or self.goal == target.position:
            return
        self.goal = target.position
        here, wanted = (float(start.pose[0]), float(start.pose[1])), 2.0 * settings.robot_radius
        found = closures(start.world.road, start.world.shapes, here, self.goal, wanted)
        self.obstacles = frozenset(name for names, _ in found for name in names)

    def update(
        self, settings: LawSettings, approach: Approach, start: PlanStart, now: int
    ) -> Contact:
        """Record the distance at `now` [ns] from what closes the road; contact with the nearest."""
        assert self.goal is not None  # noqa: S101 (something closes the road to it)
        road, pose, progress = start.world.road, start.pose, start.progress
        sense = math.copysign(1.0, arc_length_to(road, pose, self.goal, progress=progress))
        away = {}
        for shape in start.world.shapes:
            if shape.name in self.obstacles:
                along = [
                    arc_length_to(road, pose, each, progress=progress) for each in shape.corners
                ]
                least = _SHORTEST * min(sense * each for each in along)
                away[shape.name] = least - shape.radius - settings.circumscribed_radius
        contact = approach.before(away, start)
        if contact.distance < self.nearest:
            self.nearest, self.nearest_at = contact.distance, now
        return contact

    def comes_no_nearer(self, contact: Contact, now: int) -> bool:
        """True if the robot stands before it, or has not come nearer for a while at `now` [ns]."""
        return contact.speed < STANDSTILL or now - self.nearest_at > _SOON

    def wait_before(self, contact: Contact) -> str:
        """Wait from now on; why, in a sentence."""
        self.wait_reason = f'The road is closed at {contact.name}: the robot waits before it.'
        return self.wait_reason


def closures(
    road: Road, obstacles: Sequence[Shape], start: Point, goal: Point, wanted: float
) -> Iterator[tuple[list[str], float]]:
    """Chains of obstacles that no disc of diameter `wanted` passes: names, widest gap [m]."""
    if not road.has_center_line:
        return
    # A map has no corners, and is not one obstacle but many.
    obstacles = [each for each in obstacles if each.corners]
    gaps = _gaps(road, tuple(obstacles))
    if not ((gaps < wanted) | (gaps <= 0.0)).any():
        return
    pose = np.array([*start, math.nan])
    whole = arc_length_to(road, pose, goal)
    places = [[arc_length_to(road, pose, each) for each in shape.corners] for shape in obstacles]
    between = [
        index
        for index, each in enumerate(places)
        if all(0.0 < place / (whole or math.inf) < 1.0 for place in each)
    ]
    kept = [*range(_EDGES), *(_EDGES + index for index in between)]
    gaps = gaps[np.ix_(kept, kept)]
    is_closed = (gaps < wanted) | (gaps <= 0.0)
    while chain := _chain(is_closed):
        links = [float(gaps[a, b]) for a, b in pairwise(chain)]
        along = [place for each in chain[1:-1] for place in places[between[each - _EDGES]]]
        if max(along) - min(along) <= _LONGEST * road.width:
            names = [obstacles[between[each - _EDGES]].name for each in chain[1:-1]]
            yield names, max(0.0, *links)
        is_closed[chain[1:-1]] = is_closed[:, chain[1:-1]] = False


@lru_cache(maxsize=8)
def _gaps(road: Road, shapes: tuple[Shape, ...]) -> Array:
    """Widths of gaps ``(2 + M, 2 + M)``, both edges first [m]; slow on a map, so cached."""
    space, count = FreeSpace.of(road, shapes, 0.0), _EDGES + len(shapes)
    gaps = np.full((count, count), math.inf)
    whole = 1.0 / road.clearance_scale
    for index, shape in enumerate(shapes, _EDGES):
        corners = [space.at(np.array([[*each, 0.0]]))[0] for each in shape.corners]
        away = np.min(corners, axis=0)
        away[:_EDGES] *= whole
        away -= shape.radius
        away[index] = math.inf
        gaps[index] = np.minimum(gaps[index], away)
        gaps[:, index] = np.minimum(gaps[:, index], away)
    gaps.flags.writeable = False
    return gaps


def _chain(is_closed: BoolArray) -> list[int]:
    """A shortest chain from one edge to the other; empty where there is none."""
    chains, known = [[0]], {0}
    for chain in chains:
        for following in np.flatnonzero(is_closed[chain[-1]]).tolist():
            if following == 1:
                return [*chain, following]
            if following not in known:
                known.add(following)
                chains.append([*chain, following])
    return []
