"""Moves to a goal with a heading for which there is no space to turn, and a guess that drives them.

They are searched among the obstacles, a limited amount of work at a time, while the robot stands.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation.ocp_formulation import sample_space
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.pose_search import (
    Tree,
    expand,
    is_clear,
    surroundings_of,
)
from cmpsp_ros.guidance.planning.reeds_shepp import (
    REVERSAL,
    Path,
    Segment,
    clear_depth,
    cost_of,
    has_to_turn,
    paths_between,
    turning_radius,
)
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings

_AT_ONCE: Final = 16
"""Nodes that are expanded between two attempts to reach the robot."""
_ATTEMPTS: Final = 6
"""Attempts in a call: they bound its work, which takes 10 to 20 ms."""
_MAX_ATTEMPTS: Final = 600
_STROKES: Final = 0.05, 0.025, 0.0125
"""Lengths of a move, in turning radii: shorter ones are for where no path of longer ones fits."""
_TOO_DEEP: Final = 0.05
"""Depth of a path in margins that no iterations are trusted to lead out [m]."""
_SAME: Final = 0.05
"""Distance, in turning radii, and angle up to which a pose is the same [rad]."""
_FEW: Final = 3
"""Paths of an attempt that are checked."""


def needs_manoeuvres(settings: LawSettings, start: PlanStart, target: Target) -> bool:
    """True if a robot that has to drive in order to turn has no clear path of the usual kind."""
    if target.heading is None or target.drives_on or not start.world.shapes:
        return False
    return has_to_turn(start, target) and clear_depth(settings, start, target) > _TOO_DEEP


class ManoeuvreSearch:
    """Search for the moves from one pose to one goal.

    Attributes:
        path: The moves; empty where none are found, or not yet.
        is_over: True once there is no more to search for.
    """

    def __init__(self, settings: LawSettings, start: PlanStart, target: Target) -> None:
        """Take the task; nothing is searched yet."""
        assert target.heading is not None  # noqa: S101 (the caller has looked)
        self._start, self.target = start, target
        self._space = sample_space(settings, start.world)
        heading = target.heading + math.remainder(start.pose[2] - target.heading, math.tau)
        self._origin = np.array([*start.pose[:2], heading])
        goal = np.array([*target.position, target.heading])
        clear = self._space.at(np.array([start.pose, goal])).min()
        self._depth = max(0.0, -float(clear)) + 1e-6
        self._radius, self._goal = turning_radius(start.robot), goal
        self._strokes = list(_STROKES)
        self._attempts, self._best, self._until = 0, math.inf, _MAX_ATTEMPTS
        self._plant()
        self.path: Path = ()
        self.is_over = False

    def _plant(self) -> None:
        """Begin a tree of the longest moves that have not been tried."""
        things = self._space, self._depth, self._radius, self._strokes.pop(0)
        self._around, self._tree = surroundings_of(*things), Tree.at(self._goal)

    def is_for(self, start: PlanStart, target: Target) -> bool:
        """True for the same goal, from about the same place."""
        away = math.dist(start.pose[:2], self._start.pose[:2])
        turned = abs(math.remainder(start.pose[2] - self._start.pose[2], math.tau))
        return target == self.target and away < _SAME * self._radius and turned < _SAME

    def advance(self) -> None:
        """Search on."""
        for _ in range(_ATTEMPTS):
            if self.is_over:
                return
            node = expand(self._tree, self._around, self._origin, _AT_ONCE)
            self._attempts += 1
            if node >= 0:
                self._attempt(node)
            elif self._strokes and not self.path:
                self._plant()
                continue
            self.is_over = node < 0 or self._attempts >= self._until

    def _attempt(self, node: int) -> None:
        """Look for a clear path from the robot to a node."""
        tree = self._tree
        moves = tree.moves_to(node)
        # The robot drives them the other way.
        stroke = self._around.stroke
        rest = [Segment(move // 2 - 1, stroke * (2 * (move % 2) - 1)) for move in moves[::-1]]
        for first in paths_between(self._start, tree.poses[node])[:_FEW]:
            path = _joined([*first, *rest])
            cost = cost_of(path)
            if cost >= self._best:
                break
            if is_clear(self._around, self._start.pose.copy(), np.array(first)):
                if not self.path:
                    self._until = min(2 * self._attempts + _ATTEMPTS, _MAX_ATTEMPTS)
                self.path, self._best = path, cost
                break


def _joined(segments: list[Segment]) -> Path:
    """Segments with those in a row as one that go on alike."""
    path: list[Segment] = []
    for turn, length in segments:
        if path and path[-1].turn == turn and path[-1].length * length > 0.0:
            length += path.pop().length
        path.append(Segment(turn, length))
    return tuple(path)


def timed(settings: LawSettings, start: PlanStart, durations: Array, path: Path) -> Array | None:
    """A path as controls ``(N + 1, r)`` that stop to steer; None if the time is too short."""
    robot, period = start.robot, settings.control_period
    radius, change = turning_radius(robot), settings.max_wheel_change * robot.wheel_radius
    steering = np.arctan([turn * robot.wheel_base / radius for turn, _ in path])
    rate = robot.steering_limits[1] * period
    before = [start.previous_control[1], *steering[:-1]]
    pauses = [math.ceil(abs(b - a) / rate - 1e-9) - 1 for a, b in zip(before, steering, strict=True)]
    pauses = [max(each, 0) for each in pauses]
    lengths = np.abs([each.length for each in path]) * radius
    steps = len(durations) - sum(pauses)
    shares = lengths / lengths.sum() * steps
    counts = np.maximum(np.floor(shares).astype(int), 1)
    while counts.sum() > steps and counts.max() > 1:
        counts[int(np.argmax(counts - shares))] -= 1
    counts[int(np.argmax(lengths))] += steps - counts.sum()
    if counts.min() < 1:
        return None
    rows = []
    for (turn, length), angle, count, pause in zip(path, steering, counts, pauses, strict=True):
        rows += [(0.0, angle)] * pause
        ramp = np.minimum(np.arange(1.0, count + 1), np.arange(count, 0.0, -1.0))
        way = abs(length) * radius / period
        speeds = np.full(count, way / count)
        for top in range(1, count // 2 + 2):
            shape = np.minimum(ramp, top)
            speeds = shape * way / shape.sum()
            if speeds[0] <= change:
                break
        rows += [(math.copysign(each, length) / robot.wheel_radius, angle) for each in speeds]
    return np.array([*rows, (0.0, rows[-1][1])])
