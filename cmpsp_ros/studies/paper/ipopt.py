"""Independent reference: the same problem as a nonlinear program, solved by IPOPT through CasADi.

It shares no code with the method, the model or the guidance law, so a fault there cannot recur
here; only a custom model is its own function. CasADi is imported only when it is used. A point of a
corridor lies on a spline through the centre line plus an offset between the edges; a line whose
direction is a variable separates the robot from a convex shape.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.guidance.formulation import goal_space, sample_space
from cmpsp_ros.robots import Ackermann, CustomRobot, DifferentialDrive, Omnidirectional, Robot
from cmpsp_ros.studies.common import StudyError
from cmpsp_ros.studies.paper.drives import Path
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.roads import Annulus

_KNOTS = 120
_DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)
_NORMALS = np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
_OPTIONS: dict[str, Any] = {'print_level': 0, 'sb': 'yes', 'max_iter': 500}


@dataclass(frozen=True)
class ReferenceSolution:
    """Result of IPOPT."""

    feasible: bool  # true if it ended at a point that satisfies every constraint
    status: str  # IPOPT's status
    cost: float  # first term of (95) there
    controls: Array  # shape ``(N, r)``, of a differential drive its wheel speeds [rad/s]
    braking: Array  # controls that bring the robot to rest afterwards, shape ``(K, r)``
    excess: float  # maximum violation of a limit of the robot; 0 or less where all are kept
    time: float  # final time [s]


class Limits(NamedTuple):
    """Limits of quantities that are linear functions of the control; infinite for none."""

    rows: Array  # the functions, ``(q, r)``
    largest: Array  # largest magnitudes, ``(q,)``
    change: Array  # largest changes in a second, ``(q,)``

    @classmethod
    def of(cls, robot: Robot) -> Limits:
        """Limits of the wheels, and of a car's steering."""
        speed, acceleration = robot.max_wheel_speed, robot.max_wheel_acceleration
        if isinstance(robot, Ackermann):
            largest = np.array([speed, robot.max_steering_angle])
            return cls(np.eye(2), largest, np.array([acceleration, robot.max_steering_rate]))
        if isinstance(robot, CustomRobot):
            return cls(np.eye(robot.n_controls), robot.bounds, np.array(robot.change_limits))
        rows = np.eye(2)
        if isinstance(robot, Omnidirectional):
            rims = np.array(robot.rims)
            rows = rims @ np.linalg.inv(rims[robot.driven])
        return cls(rows, np.full(len(rows), speed), np.full(len(rows), acceleration))


def reference_solution(settings: GuidanceSettings, pose: Array, start: Path) -> ReferenceSolution:
    """Minimise the first term of (95) over the whole horizon at once, or with `goal.when` the time.

    All steps have one duration then, and the robot may be at rest after the last of them. The
    start, a path from the pose ``(3,)``, decides on which side obstacles are passed; with
    `safety.between_samples` the space is shrunk to keep the path between samples clear. Raises
    StudyError without CasADi, or for an unknown robot.
    """
    try:
        import casadi  # noqa: PLC0415 (only needed here)
    except ImportError as error:
        text = 'casadi: not installed, wanted for the judge; pip install casadi'
        raise StudyError(text) from error
    steps = round(settings.final_time / settings.control_period)
    robot, space = settings.robot, sample_space(settings, settings.world)
    end = goal_space(settings, settings.world, settings.target) or space
    stopping, change = 0, settings.max_wheel_change
    if change < math.inf and not settings.is_soonest:
        # Afterwards it comes to rest from any speed.
        stopping = math.ceil(settings.robot.max_wheel_speed / change) + 1
    start = _braked(start, steps, stopping)
    opti = casadi.Opti()
    U = opti.variable(robot.n_controls, steps + stopping)
    X = opti.variable(3, steps + stopping + 1)
    opti.subject_to(X[:, 0] == pose)
    period: Any = settings.control_period
    if settings.is_soonest:
        period = opti.variable()
        opti.subject_to(period >= 0.0)
        opti.set_initial(period, settings.control_period)
    constraints = _SpaceConstraints(casadi, opti, settings, start)
    cost: Any = constraints.off_center(X[:2, 0], 0, space) ** 2
    for k in range(steps + stopping):
        step = motion(casadi, robot, X[2, k], U[:, k], period)
        if robot.max_lateral_acceleration < math.inf:
            ahead, aside, turn_rate = _twist(casadi, robot, U[:, k])
            squared = (ahead**2 + aside**2) * turn_rate**2
            opti.subject_to(squared <= robot.max_lateral_acceleration**2)
        opti.subject_to(X[:, k + 1] == X[:, k] + step)
        here = end if k + 1 == steps else space
        off_center = constraints.off_center(X[:2, k + 1], k + 1, here)
        cost += off_center**2 if k < steps else 0.0
        constraints.keep_clear(X[:2, k + 1], k + 1, here)
    opti.subject_to(X[:2, steps] == np.array(settings.goal))
    _limit(casadi, opti, robot, U, period, rests=settings.is_soonest)
    if stopping:
        opti.subject_to(U[: robot.time_scaling.scaled, -1] == 0.0)
    cost = 0.5 * settings.weights.road_center * cost
    # Without a centre line the least turning of the wheels.
    goal = cost if settings.road.has_center_line else casadi.sumsqr(U)
    opti.minimize(steps * period if settings.is_soonest else goal)
    opti.set_initial(U, start.controls.T)
    opti.set_initial(X, start.poses.T)
    opti.solver('ipopt', {'print_time': False}, _OPTIONS)
    # It raises where it finds nothing; the last iterate remains.
    with contextlib.suppress(RuntimeError):
        opti.solve()
    status = opti.return_status()
    duration = float(opti.debug.value(period))
    found = np.asarray(opti.debug.value(U)).reshape(robot.n_controls, -1).T
    return ReferenceSolution(
        feasible=status in {'Solve_Succeeded', 'Solved_To_Acceptable_Level'},
        status=status,
        cost=float(opti.debug.value(cost)),
        controls=found[:steps],
        braking=found[steps:],
        excess=limit_excess(robot, found, duration),
        time=steps * duration,
    )


def motion(casadi: Any, robot: Robot, heading: Any, control: Any, duration: Any) -> Any:
    """Change of the pose under a constant control, as an expression ``(3,)``."""
    ahead, aside, turn_rate = _twist(casadi, robot, control)
    half = turn_rate * duration / 2.0
    # sin(a) / a by its series, exact to rounding for every turn of a control period.
    square = half * half
    sinc = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
    cosine, sine = casadi.cos(heading + half), casadi.sin(heading + half)
    x, y = ahead * cosine - aside * sine, ahead * sine + aside * cosine
    return casadi.vertcat(x * sinc * duration, y * sinc * duration, 2.0 * half)


def _twist(casadi: Any, robot: Robot, control: Any) -> tuple[Any, Any, Any]:
    """Speed forward and to the left, and turn rate, as expressions."""
    aside: Any = 0.0
    if isinstance(robot, DifferentialDrive):
        ahead = (control[0] + control[1]) * robot.wheel_radius / 2.0
        turn_rate = (control[0] - control[1]) * robot.wheel_radius / (2.0 * robot.half_track)
    elif isinstance(robot, Ackermann):
        ahead = control[0] * robot.wheel_radius
        turn_rate = ahead * casadi.tan(control[1]) / robot.wheel_base
    elif isinstance(robot, Omnidirectional):
        rims = np.array(robot.rims)[robot.driven] / robot.wheel_radius
        twist = casadi.DM(np.linalg.inv(rims)) @ control
        ahead, aside, turn_rate = twist[0], twist[1], twist[2]
    elif isinstance(robot, CustomRobot):
        found = robot.motion(robot.constants, *(control[k] for k in range(robot.n_controls)))
        ahead, aside, turn_rate = (robot.wheel_radius * each for each in found)
    else:
        name = type(robot).__name__
        raise StudyError(f'robot.model: found {name}, wanted one that the judge knows')
    return ahead, aside, turn_rate


def limit_excess(robot: Robot, controls: Array, period: float) -> float:
    """Maximum violation of a limit by controls ``(N, r)`` from rest; 0 or less for none."""
    limits = Limits.of(robot)
    values = controls @ limits.rows.T
    changes = np.diff(values, axis=0, prepend=0.0 * values[:1])
    beyond = np.abs(values) - limits.largest, np.abs(changes) - limits.change * period
    return float(np.max(beyond))


def _limit(
    casadi: Any, opti: Any, robot: Robot, controls: Any, period: Any, *, rests: bool
) -> None:
    """Constrain controls ``(r, N)`` to the limits of a robot that begins at rest, or ends there."""
    limits = Limits.of(robot)
    values = limits.rows @ controls
    before = casadi.horzcat(casadi.DM.zeros(len(limits.rows), 1), values[:, :-1])
    for row, (largest, change) in enumerate(zip(limits.largest, limits.change, strict=True)):
        if largest < math.inf:
            opti.subject_to(opti.bounded(-largest, values[row, :].T, largest))
        if change < math.inf:
            at_once = change * period
            changes = (values - before)[row, :].T
            changes = casadi.vertcat(changes, values[row, -1]) if rests else changes
            opti.subject_to(changes <= at_once)
            opti.subject_to(changes >= -at_once)
            if row < robot.n_speeds and robot.max_wheel_jerk < math.inf:
                smooth = casadi.diff(casadi.vertcat(0.0, changes, -values[row, -1], 0.0))
                smooth = smooth if rests else smooth[: changes.numel()]
                steady = robot.max_wheel_jerk * period**2
                opti.subject_to(smooth <= steady)
                opti.subject_to(smooth >= -steady)


def _braked(start: Path, steps: int, stopping: int) -> Path:
    """A path of `steps + stopping` steps that slows down along its last arc."""
    missing = steps + stopping - len(start.controls)
    if missing <= 0:
        return start
    robot, period = start.settings.robot, start.settings.control_period
    last = start.controls[-1]
    slower = [robot.slowed(last, 1.0 - k / missing) for k in range(1, missing + 1)]
    poses = robot.roll_out(start.poses[-1], np.array(slower), np.full(missing, period))
    return replace(
        start,
        poses=np.vstack([start.poses, poses[1:]]),
        controls=np.vstack([start.controls, slower]),
    )


class _SpaceConstraints:
    """Road and obstacles as constraints of a program, stage by stage."""

    def __init__(self, casadi: Any, opti: Any, settings: GuidanceSettings, start: Path) -> None:
        self._casadi, self._opti, self._start = casadi, opti, start
        road = settings.road
        self._road, stages = road, len(start.poses)
        if isinstance(road, Annulus) or not road.has_center_line:
            return
        line = road.center_line()
        left, right = (np.hypot(*(edge - line).T) for edge in road.edges())
        along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
        knots = np.linspace(0.0, along[-1], _KNOTS)
        normal = (road.edges()[0] - line) / left[:, None]
        columns = (*line.T, *normal.T, left, right)
        tables = [np.interp(knots, along, each) for each in columns]
        self._tables = [casadi.interpolant('table', 'bspline', [knots], table) for table in tables]
        self._places, self._offsets = opti.variable(stages), opti.variable(stages)
        away = start.poses[:, None, :2] - line
        nearest = np.argmin((away**2).sum(axis=2), axis=1)
        opti.set_initial(self._places, along[nearest])
        opti.set_initial(self._offsets, (away[np.arange(stages), nearest] * normal[nearest]).sum(1))

    def off_center(self, point: Any, k: int, space: FreeSpace) -> Any:
        """Keep stage `k` on the road; its signed distance from the centre line [m], 0 for none."""
        if not self._road.has_center_line:
            return 0.0
        if isinstance(self._road, Annulus):
            edges = space.annulus
            radius = self._casadi.sqrt(self._casadi.sumsqr(point - edges.center))
            if k > 0:
                inner, outer = float(edges.inner[0]), float(edges.outer[0])
                self._opti.subject_to(self._opti.bounded(inner, radius, outer))
            return radius - edges.center_radius
        place, offset = self._places[k], self._offsets[k]
        x, y, normal_x, normal_y, left, right = (table(place) for table in self._tables)
        self._opti.subject_to(point[0] == x + offset * normal_x)
        self._opti.subject_to(point[1] == y + offset * normal_y)
        if k > 0:
            kept = space.road.kept[0] / self._road.clearance_scale
            self._opti.subject_to(offset <= left - float(kept[0]))
            self._opti.subject_to(offset >= float(kept[1]) - right)
        return offset

    def keep_clear(self, point: Any, k: int, space: FreeSpace) -> None:
        """Keep stage `k` clear of the shapes."""
        shapes = np.split(space.corners[0], space.first[1:-1]) if len(space.radii) else []
        for corners, kept in zip(shapes, space.radii.tolist(), strict=True):
            if len(corners) == 1:
                self._opti.subject_to(self._casadi.sumsqr(point - corners[0]) >= kept**2)
                continue
            angle = self._opti.variable()
            away = (self._start.poses[k, :2] - corners) @ _NORMALS.T
            self._opti.set_initial(angle, _DIRECTIONS[away.min(axis=0).argmax()])
            normal = self._casadi.vertcat(self._casadi.cos(angle), self._casadi.sin(angle))
            for corner in corners:
                self._opti.subject_to(self._casadi.dot(normal, point - corner) >= kept)
