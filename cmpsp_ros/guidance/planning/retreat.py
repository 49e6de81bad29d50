"""Retreat from what comes at the robot and closes its way: to where it is not touched.

On a grid around it, it can be at a time in clear cells beside those of the time before; of those
left in the end, it goes to a near one where it can stay for long.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.unseen import looks_ahead
from cmpsp_ros.guidance.safety.validation import TOUCHING
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Robot, placed
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import MovingDiscs
from cmpsp_ros.world.roads import Point

_CELLS: Final = 16  # cells from the robot to the grid's border, and times looked at
_ROOM, _SOONEST, _LATEST = 2.0, 3.0, 6.0
"""Distance that a robot can retreat in the time that is looked ahead [m], and its limits [s]."""
_LONG: Final = 15.0  # time from which on a place is as good as one for good [s]
_LONGER: Final = 2.0  # factor on the time that a plan is clear before it is followed again
_KEPT: Final = 1.0  # time that another place must be better than the one chosen before [s]
_SLOWED: Final = 0.7  # speed of a robot that turns on its way, as a fraction of its largest
_TURN_RATE, _ALIGNED = 2.0, 0.5  # as of `Pace`
_MOVES: Final = 0.05  # speed from which on something counts that comes at the robot [m/s]


class RetreatPlanner:
    """Plans retreats for one set of settings."""

    def __init__(self, settings: LawSettings) -> None:
        self._settings, robot = settings, settings.robot
        self._top = robot.max_speed if math.isfinite(robot.max_speed) else settings.pace
        self._pace = Pace(self._top, _TURN_RATE, _ALIGNED)
        speed = _SLOWED * self._top
        self.seconds = min(max(_ROOM / speed, _SOONEST), _LATEST)  # looked ahead
        self._cell = speed * self.seconds / _CELLS
        self._kept = settings.circumscribed_radius + settings.safety.margin
        axis = self._cell * np.arange(-_CELLS, _CELLS + 1)
        self._grid = np.stack(np.meshgrid(axis, axis, indexing='ij'), axis=-1)

    def threats(self, start: PlanStart) -> MovingDiscs:
        """Obstacles expected near in time, but for robots and those that touch this one already."""
        moving, seconds = start.moving, self.seconds
        reach = self._kept + self._cell * _CELLS
        near = moving.within(start.pose, reach, seconds)
        speeds = np.hypot(*moving.states[near, 2:4].T)
        places = placed(self._settings.footprint.discs, start.pose)
        begins = moving.clearance(places).min(axis=0)[near]
        is_threat = (speeds > _MOVES) & (begins > self._settings.robot_radius)
        own = [index for index in near[is_threat].tolist() if index not in moving.ways]
        chosen = moving.chosen(np.array(own, dtype=np.int64))
        chosen.states[:, 5:] = 0.0
        return chosen

    def touched_at_rest(self, start: PlanStart, threats: MovingDiscs) -> str:
        """Name of the first that touches a robot at rest; '' if none does."""
        times = np.linspace(0.0, self.seconds, 4 * _CELLS)
        touches = self._clearance(start, threats, times) < 0.0
        if not touches.any():
            return ''
        return threats.names[int(touches[int(touches.any(axis=1).argmax())].argmax())]

    def is_blocked(
        self, plan: Plan, start: PlanStart, threats: MovingDiscs, *, for_long: bool
    ) -> bool:
        """True if a plan leads into something in the time that is looked ahead, or in a longer."""
        ends = np.cumsum(plan.horizon.durations)
        seconds = _LONGER * self.seconds if for_long else self.seconds
        count = int(np.searchsorted(ends, seconds)) + 1
        durations = plan.horizon.durations[:count]
        twists, poses = start.robot.twist(plan.controls[: len(durations)]), plan.poses[:-1][:count]
        times = ends[: len(durations)] - durations
        settings, arcs = self._settings, (poses, twists, durations)
        still = start.world.free_space(settings).along(*arcs, start.progress)
        if still.min() < -TOUCHING:
            return True
        discs = threats.grown(settings.robot_radius)
        return bool((discs.along(*arcs, times, settings.footprint.discs) < 0.0).any())

    def find(
        self, context: PlanningContext, threats: MovingDiscs, before: Point | None
    ) -> tuple[Plan, Point] | None:
        """Plan to a refuge, near the one `before` if there is one, and its position [m]."""
        start = context.start
        layers = self._layers(start, threats)
        if not layers[-1].any():
            return None
        goal = self._refuge(start, threats, layers[-1], before)
        path = start.pose[:2] + self._path(layers, goal)
        looks_back = looks_ahead(self._settings, start, start.pose[None], np.array([-1.0, 0.0]))
        near, at = 2 * self._cell, 0.5 * self._cell
        plan = drive_along(context, path, self._pace, near, at, looks_back=looks_back)
        x, y = (start.pose[:2] + self._grid[goal]).tolist()
        return plan, (x, y)

    def _clearance(self, start: PlanStart, discs: MovingDiscs, times: Array) -> Array:
        """Clearance of the robot at rest from each disc, shape ``(K, M)`` [m]."""
        centers, radii = discs.at_times(times)
        places = placed(self._settings.footprint.discs, start.pose)
        away = np.linalg.norm(centers[:, :, None] - places, axis=-1).min(axis=-1)
        clear: Array = away - radii - self._settings.robot_radius
        return clear

    def _layers(self, start: PlanStart, threats: MovingDiscs) -> BoolArray:
        """Cells in which the robot can be at each time, ``(T, G, G)``."""
        places = start.pose[:2] + self._grid
        flat = places.reshape(-1, 2)
        space = FreeSpace.of(start.world.road, start.world.shapes, self._kept)
        at = np.column_stack([flat, np.full(len(flat), start.pose[2])])
        free = (space.at(at, start.progress).min(axis=1) >= 0.0).reshape(places.shape[:2])
        free[_CELLS, _CELLS] = True
        layers = np.zeros((_CELLS + 1, *free.shape), dtype=bool)
        layers[0, _CELLS, _CELLS] = True
        times: Array = self.seconds / _CELLS * np.arange(1.0, _CELLS + 1)
        centers, radii = threats.at_times(times)
        spread(layers, free, places, centers, np.square(radii + self._kept))
        return layers

    def _refuge(
        self, start: PlanStart, threats: MovingDiscs, cells: BoolArray, before: Point | None
    ) -> tuple[int, int]:
        """Index of the best cell: long to stay at, near, and where the robot is going already."""
        index = np.argwhere(cells)
        offsets = self._grid[cells]
        places = start.pose[:2] + offsets
        value = np.minimum(self._time_left(threats.after(self.seconds), places), _LONG)
        value -= np.hypot(*offsets.T) / self._top
        if before is not None:
            is_near = np.hypot(*(places - np.array(before)).T) < 1.5 * self._cell
            value = np.where(is_near, value + _KEPT, value)
        row, column = index[int(value.argmax())].tolist()
        return row, column

    def _time_left(self, threats: MovingDiscs, places: Array) -> Array:
        """Time until something touches a robot that stands at places ``(K, 2)`` [s]."""
        states = threats.states
        away, velocity = places[:, None] - states[:, :2], states[:, 2:4]
        squared = (velocity**2).sum(axis=1)
        along = (away * velocity).sum(axis=-1)
        inside = (away**2).sum(axis=-1) - (states[:, 4] + self._kept) ** 2
        root = along**2 - squared * inside
        hits = (root > 0.0) & (along > 0.0)
        times = np.where(hits, (along - np.sqrt(np.maximum(root, 0.0))) / squared, math.inf)
        left: Array = np.maximum(times, 0.0).min(axis=1, initial=math.inf)
        return left

    def _path(self, layers: BoolArray, goal: tuple[int, int]) -> Array:
        """Positions on the way to a cell, relative to the robot; it waits at the end."""
        cells = [np.array(goal)]
        for k in range(len(layers) - 2, -1, -1):
            before = layers[k]
            if before[tuple(cells[-1])]:
                continue
            beside = cells[-1] + _BESIDE
            inside = beside[((beside >= 0) & (beside < len(before))).all(axis=1)]
            known = inside[before[inside[:, 0], inside[:, 1]]]
            # The straightest way: the cell nearest to the line to the robot.
            cells.append(known[int(np.hypot(*(known - _CELLS).T).argmin())])
        path: Array = self._grid[tuple(np.array(cells[::-1]).T)]
        return path


class Pace(NamedTuple):
    """Limits of a robot that is driven from point to point."""

    speed: float  # along its path [m/s]
    turn_rate: float  # on the spot [rad/s]
    aligned: float  # angle to its way up to which it drives rather than turns on the spot [rad]


def drive_along(
    context: PlanningContext,
    path: Array,
    pace: Pace,
    near: float,
    at: float,
    *,
    looks_back: bool = True,
) -> Plan:
    """Plan along a path ``(K, 2)``, ahead or backwards, in pursuit of a point not `near` [m].

    It ends where the robot is `at` the last point, up to such a distance [m].
    """
    robot, durations, controls = (
        context.start.robot,
        context.horizon.durations,
        context.zero_controls,
    )
    pose, reached = context.start.pose, 0
    for k, duration in enumerate(durations.tolist()):
        while reached < len(path) - 1 and math.dist(pose[:2], path[reached]) < near:
            reached += 1
        if math.dist(pose[:2], path[reached]) < at:
            break
        to = path[reached]
        twist = _twist_towards(robot, pose, to, duration, pace, looks_back=looks_back)
        controls[k] = robot.limited(robot.controls(twist))
        pose = robot.roll_out(pose, controls[k : k + 1], durations[k : k + 1])[-1]
    return context.driven(controls)


def _twist_towards(
    robot: Robot, pose: Array, point: Array, duration: float, pace: Pace, *, looks_back: bool
) -> Array:
    """Twist to a point with the nearer end ahead; if it cannot look back, it turns if it can."""
    x, y = point - pose[:2]
    distance = math.dist(pose[:2], point)
    angle = math.remainder(math.atan2(y, x) - pose[2], math.tau)
    speed = min(pace.speed, distance / duration)
    if robot.drives_sideways:
        return np.array([speed * math.cos(angle), speed * math.sin(angle), 0.0])
    if abs(angle) > math.pi / 2.0 and (looks_back or not robot.turns_on_the_spot):
        angle, speed = math.remainder(angle - math.pi, math.tau), -speed
    if robot.turns_on_the_spot and abs(angle) > pace.aligned:
        return np.array([0.0, math.copysign(min(abs(angle) / duration, pace.turn_rate), angle)])
    curvature = 2.0 * math.sin(angle) / distance
    curvature = min(max(curvature, -robot.max_curvature), robot.max_curvature)
    return np.array([speed, abs(speed) * curvature])


_BESIDE: Final[IntArray] = np.argwhere(np.ones((3, 3), dtype=bool)) - 1


@allocation_free
def spread(
    layers: BoolArray, free: BoolArray, places: Array, centers: Array, squared: Array
) -> None:
    """Fill in free cells beside those of the time before, every other time at a corner too."""
    steps, rows, columns = layers.shape
    for k in range(steps - 1):
        for i in range(rows):
            for j in range(columns):
                is_beside = False
                for m in range(max(i - 1, 0), min(i + 2, rows)):
                    for n in range(max(j - 1, 0), min(j + 2, columns)):
                        is_beside |= layers[k, m, n] and (k % 2 == 0 or m == i or n == j)
                is_clear = is_beside and free[i, j]
                for d in range(squared.shape[1] if is_clear else 0):
                    x, y = places[i, j, 0] - centers[k, d, 0], places[i, j, 1] - centers[k, d, 1]
                    is_clear &= x * x + y * y > squared[k, d]
                layers[k + 1, i, j] = is_clear
