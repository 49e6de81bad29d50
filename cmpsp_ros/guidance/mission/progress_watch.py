"""Progress on the way to a goal, counted in control steps, and the reason why there is none."""

import math
from dataclasses import dataclass, field, replace
from enum import IntEnum
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import SEEN
from cmpsp_ros.world.roads import Point, remaining_arc_length

_PLACE: Final = 0.25  # side of the squares that count as new ground once [m]
_NEARER: Final = 0.02  # least length by which the way becomes shorter [m]
_SPACING: Final = 0.05  # distance of the points of the trail [m]
_LONGEST: Final = 400  # their number
SPACING: Final = 0.05  # distance of the points of a way at which its clearance is measured [m]


class Remedy(IntEnum):
    """Remedies for a lack of progress, in the order in which they are tried."""

    NONE = 0
    OTHER_CLASS = 1
    OTHER_WAY = 2
    BACK_OUT = 3
    TURN = 4
    GIVE_UP = 5


@dataclass
class ProgressWatch:
    """Progress on the way to the present goal."""

    steps: int = 0  # control steps without progress, since the last remedy
    remedy: Remedy = Remedy.NONE  # the last one tried
    begun_at: Array | None = None  # pose where it began to back out or to turn; None if it does not
    heading: float = 0.0  # heading at the last step of such a move [rad]
    turned: float = 0.0  # angle by which it has turned since it began [rad]
    refused: int = 0  # number of control steps in a row in which no such move was clear
    nearest: float = math.inf  # least length of the way to the goal so far [m]
    stood_at: tuple[float, float] = (math.inf, math.inf)  # where it was at the last progress [m]
    is_closed: bool = False  # true while every way leads through a place that did not fit
    visited: set[tuple[int, int]] = field(default_factory=set)  # squares of the floor
    trail: list[tuple[float, float]] = field(default_factory=list)  # positions, the last one last
    driven: float = 0.0  # length of all that was driven, but for backing out [m]

    def drive(self, pose: Array) -> None:
        """Remember where the robot has been; backing out unwinds that."""
        here = float(pose[0]), float(pose[1])
        if self.begun_at is not None:
            while len(self.trail) > 1 and math.dist(self.trail[-1], here) < 2.0 * _SPACING:
                self.trail.pop()
        elif not self.trail or math.dist(self.trail[-1], here) >= _SPACING:
            self.driven += math.dist(self.trail[-1], here) if self.trail else 0.0
            self.trail = [*self.trail[1 - _LONGEST :], here]

    def begin_move(self, pose: Array) -> None:
        """Begin to back out or to turn at a pose ``(3,)`` [m, m, rad]."""
        self.begun_at, self.heading, self.turned = pose, float(pose[2]), 0.0

    def turn(self, heading: float) -> None:
        """Count how far it has turned; a heading [rad] may be wrapped."""
        self.turned += math.remainder(heading - self.heading, math.tau)
        self.heading = heading

    def count(self, pose: Array, left: float, *, is_excused: bool = False) -> None:
        """Count a step without progress, unless excused; `left` of the way [m], inf without one."""
        here = float(pose[0]), float(pose[1])
        place = math.floor(pose[0] / _PLACE), math.floor(pose[1] / _PLACE)
        # As more is seen the way changes its length: to a robot that stands that is no progress.
        is_nearer = left < self.nearest - _NEARER and math.dist(here, self.stood_at) > _SPACING
        self.is_closed = self.is_closed and not is_nearer
        is_new = place not in self.visited and math.isfinite(left) and not self.is_closed
        self.visited.add(place)
        self.steps += not is_excused
        # The first length of another way is no progress on it.
        if is_new or (is_nearer and math.isfinite(self.nearest)):
            self.reset()
        if is_new or is_nearer:
            self.nearest, self.stood_at = min(self.nearest, left), here

    def reset(self) -> None:
        """Begin again: there is progress."""
        self.steps, self.remedy = 0, Remedy.NONE

    def close(self, detour: float) -> None:
        """Count no way through a place that did not fit as progress, which costs so much [m]."""
        self.nearest, self.is_closed = self.nearest + detour, True

    @property
    def way_back(self) -> Array:
        """Positions from the latest one back, shape ``(K, 2)`` [m]."""
        return np.array(self.trail[::-1], dtype=float).reshape(-1, 2)


def way_left(settings: LawSettings, start: PlanStart, goal: Target) -> float:
    """Length of the way to the goal; infinite where none is known [m]."""
    if (search := start.world.map_search(settings)) is not None:
        return float(search.lengths(start.pose[None, :2], goal.position)[0])
    along = remaining_arc_length(
        start.world.road, start.pose[None], goal.position, goal.heading, start.progress
    )
    return abs(float(along[0]))


def tightest(settings: LawSettings, start: PlanStart, line: Array) -> tuple[Point, float, str]:
    """Place of least clearance on a line (x, y) [m], that clearance [m], and beside what."""
    space, poses = start.world.free_space(settings), np.zeros((len(line), 3))
    poses[:, :2] = line
    away = space.at(poses)
    k, j = np.unravel_index(int(away.argmin()), away.shape)
    return (float(line[k, 0]), float(line[k, 1])), float(away[k, j]), start.world.names[j]


def why_unreachable(
    settings: LawSettings, start: PlanStart, goal: Point, blocked: tuple[Point, ...], last: str
) -> str:
    """Sentence on what closes which way, at `blocked` places; `last` where all is wide enough."""
    search, places = start.world.map_search(settings), [start.pose[None, :2]]
    if search is not None:
        line = search.line(start.pose[:2], goal, SPACING)
        places = [np.array([each]) for each in blocked] or [line]
        if not len(line):
            # The way of a point shows what is too narrow, or the wall that is thinnest.
            point = replace(search, wanted=0.0, margin=0.0, body=-math.inf, blocked=())
            line = point.line(start.pose[:2], goal, SPACING)
            places = [line if len(line) else np.array([goal])]
    body, parts, least, is_coarse = settings.robot_radius, [], math.inf, False
    margin, cell = settings.safety.margin, settings.sight.resolution
    for each in places:
        (x, y), clear, name = tightest(settings, start, each)
        least = min(least, clear)
        is_coarse |= name == f'obstacle {SEEN}' and -cell <= clear < margin
        beside = max(clear + body, 0.0)
        parts.append(f'past {name} at ({x:.2f}, {y:.2f}), which leaves {beside:.3f} m')
    reason = (
        f'The goal is unreachable: no plan gets {", nor ".join(parts)} beside the path; the'
        f' robot needs {body:.3f} m, and {margin:.3f} m of margin.'
    )
    if is_coarse:
        reason += (
            f' Cells of {cell:.3g} m make what is seen up to as much larger on each side: a smaller'
            ' sight.resolution may find space.'
        )
    return f'{reason} {last}' if least >= 0.0 else reason
