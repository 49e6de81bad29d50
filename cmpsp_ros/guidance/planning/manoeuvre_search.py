"""Search, while the robot stands, for moves to a goal with a heading where it cannot turn."""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.guidance.formulation.ocp_formulation import sample_space
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.pose_search import Surroundings, Tree, expand, is_clear
from cmpsp_ros.guidance.planning.reeds_shepp import (
    LEFT,
    STRAIGHT,
    Path,
    Segment,
    clear_depth,
    cost_of,
    has_to_turn,
    length_of,
    paths_between,
    turning_radius,
)
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.robots import Robot
from cmpsp_ros.world import FreeSpace

_AT_ONCE: Final = 16  # nodes that are expanded between two attempts to reach the robot
_ATTEMPTS: Final = 6  # attempts in a call: they bound its work, which takes 10 to 20 ms
_MAX_ATTEMPTS: Final = 600
_NEAR: Final = 8.0  # distance, in lengths, from which one that turns on the spot searches
_STROKES: Final = 0.05, 0.025, 0.0125  # lengths of a move, in turning radii, the longest first
_TOO_DEEP: Final = 0.05  # depth of a path in margins that no iterations are trusted to lead out [m]
_SAME: Final = 0.05  # distance, in turning radii, and angle up to which a pose is the same [rad]
_FEW: Final = 3  # paths of an attempt that are checked


def may_need_manoeuvres(settings: LawSettings) -> bool:
    """True for a robot that has to drive in order to turn, or has corners that turn with it."""
    robot = settings.robot
    has_corners = bool(settings.footprint.corners) and not robot.drives_sideways
    return has_corners or not robot.turns_on_the_spot


def needs_manoeuvres(settings: LawSettings, start: PlanStart, target: Target) -> bool:
    """True if no simple path to a goal with a heading is clear for a robot that has to turn."""
    if target.heading is None or target.drives_on or not start.world.shapes:
        return False
    robot = start.robot
    if not robot.turns_on_the_spot:
        return has_to_turn(start, target) and clear_depth(settings, start, target) > _TOO_DEEP
    is_near = math.dist(start.pose[:2], target.position) < _NEAR * _length(settings, robot)
    if not is_near or not may_need_manoeuvres(settings):
        return False
    around = _around(settings, start, sample_space(settings, start.world), _TOO_DEEP, _STROKES[0])
    goal = np.array([*target.position, target.heading])
    paths = _turning_paths(start, goal, around.radius)
    return not any(is_clear(around, start.pose.copy(), np.array(each)) for each in paths)


def _length(settings: LawSettings, robot: Robot) -> float:
    """Turning radius; of a robot that turns on the spot, the radius about its corners [m]."""
    return settings.circumscribed_radius if robot.turns_on_the_spot else turning_radius(robot)


def _around(
    settings: LawSettings, start: PlanStart, space: FreeSpace, depth: float, stroke: float
) -> Surroundings:
    length, turns = _length(settings, start.robot), start.robot.turns_on_the_spot
    return Surroundings(space.data, depth, length, turns, stroke)


def _turning_paths(start: PlanStart, pose: Array, length: float) -> list[Path]:
    """A turn on the spot, straight ahead or back, and another turn."""
    x, y, heading = pose - start.pose
    paths = []
    for gear in (1.0, -1.0):
        first = math.remainder(math.atan2(gear * y, gear * x) - start.pose[2], math.tau)
        last = math.remainder(heading - first, math.tau)
        straight = gear * math.hypot(x, y) / length
        paths.append((Segment(LEFT, first), Segment(STRAIGHT, straight), Segment(LEFT, last)))
    return sorted(paths, key=length_of)


class ManoeuvreSearch:
    """Search for the moves from one pose to one goal."""

    def __init__(self, settings: LawSettings, start: PlanStart, target: Target) -> None:
        assert target.heading is not None  # noqa: S101 (the caller has looked)
        self._settings, self._start, self.target = settings, start, target
        self._space = sample_space(settings, start.world)
        heading = target.heading + math.remainder(start.pose[2] - target.heading, math.tau)
        self._origin = np.array([*start.pose[:2], heading])
        goal = np.array([*target.position, target.heading])
        clear = self._space.at(np.array([start.pose, goal])).min()
        self._depth = max(0.0, -float(clear)) + 1e-6
        self._length, self._goal = _length(settings, start.robot), goal
        self._strokes = list(_STROKES)
        self._attempts, self._best, self._until = 0, math.inf, _MAX_ATTEMPTS
        self._plant()
        self.path: Path = ()  # the moves; none are found yet
        self.is_over = False

    def _plant(self) -> None:
        """Begin a tree of the longest moves that have not been tried."""
        things = self._space, self._depth, self._strokes.pop(0)
        self._around = _around(self._settings, self._start, *things)
        self._tree = Tree.at(self._goal)

    def is_for(self, start: PlanStart, target: Target) -> bool:
        """True for the same goal, from about the same place."""
        away = math.dist(start.pose[:2], self._start.pose[:2])
        turned = abs(math.remainder(start.pose[2] - self._start.pose[2], math.tau))
        return target == self.target and away < _SAME * self._length and turned < _SAME

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
        if self._around.turns_on_the_spot:
            paths = _turning_paths(self._start, tree.poses[node], self._length)
        else:
            paths = paths_between(self._start, tree.poses[node])[:_FEW]
        for first in paths:
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
    for each in segments:
        goes_on = path and path[-1].turn == each.turn and path[-1].length * each.length > 0.0
        before = path.pop().length if goes_on else 0.0
        path.append(Segment(each.turn, before + each.length))
    return tuple(path)


def timed(settings: LawSettings, start: PlanStart, durations: Array, path: Path) -> Array | None:
    """A path as controls ``(N + 1, r)``, with stops to steer; None if the time is too short."""
    robot, period = start.robot, settings.control_period
    length, change = _length(settings, robot), settings.max_wheel_change * robot.wheel_radius
    units, ways, pauses, steering = [], [], [], start.previous_control
    for turn, part in path:
        gear, on_the_spot = math.copysign(1.0, part), robot.turns_on_the_spot and turn
        arc = np.array([gear, turn * gear / length])
        unit = robot.controls(
            np.array([0.0, turn * gear / robot.half_track]) if on_the_spot else arc
        )
        ways.append(abs(part) * (robot.half_track if on_the_spot else length))
        pauses.append(int(change < math.inf))
        if robot.steering_limits is not None:
            steps = abs(unit[-1] - steering[-1]) / (robot.steering_limits[1] * period)
            pauses[-1] = max(math.ceil(steps - 1e-9) - 1, pauses[-1])
        steering = unit
        units.append(unit)
    counts = _shares(np.array(ways), len(durations) - sum(pauses))
    if counts.min() < 1:
        return None
    scaled, rows = np.arange(robot.n_controls) < robot.n_speeds, [start.previous_control]
    for unit, way, pause, count in zip(units, ways, pauses, counts.tolist(), strict=True):
        turned = (unit - rows[-1]) / (pause + 1)
        still = [rows[-1] + turned * step for step in range(1, pause + 1)]
        rows += [np.where(scaled, 0.0, each) for each in still]
        rows += [
            np.where(scaled, speed * unit, unit) for speed in _speeds(way / period, count, change)
        ]
    return np.array([*rows[1:], np.where(scaled, 0.0, rows[-1])])


def _shares(ways: Array, steps: int) -> IntArray:
    """Steps for each of some ways, about as long as it is, one at least; fewer if too few."""
    shares = ways / ways.sum() * (steps - len(ways))
    counts: IntArray = 1 + np.floor(shares).astype(np.int64)
    counts[int(np.argmax(ways))] += steps - counts.sum()
    return counts


def _speeds(way: float, count: int, change: float) -> list[float]:
    """Speeds of a way in so many steps that begins and ends slowly where changes are limited."""
    ramp = np.minimum(np.arange(1.0, count + 1), np.arange(count, 0.0, -1.0))
    shapes = (np.minimum(ramp, top) for top in range(1, count + 1))
    speeds = [shape * way / shape.sum() for shape in shapes]
    return list(next((each for each in speeds if each[0] <= change), speeds[-1]).tolist())
