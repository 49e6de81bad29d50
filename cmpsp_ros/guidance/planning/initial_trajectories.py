"""Initial control histories: pursuit of a point ahead on the centre line, or on another path."""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.homotopy.road_frame import (
    RoadFrame,
    lengths,
    locate,
    point_at,
    stretch_at,
    wrapped,
)
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.robots.motion import Kinematics, drive, fastest_wheel, within_limits
from cmpsp_ros.robots.motion import steer as steer_by
from cmpsp_ros.world.roads import RoadSpace, road_functions

SHORTEST_LOOKAHEAD: Final = 0.3  # distance of the nearest point that is pursued [m]
_ROAD_LOOKAHEAD: Final = 1.0  # distance of the point pursued on a road, as a time [s]
_PATH_LOOKAHEAD: Final = 0.35  # the same on a path
_SPOT: Final = 0.5  # angle from which on a robot at rest turns on the spot [rad]
_BACKWARD: Final = 0.5  # largest speed backward, relative to the robot's


class Pursuit(NamedTuple):
    """A robot in pursuit of points."""

    robot: Kinematics
    max_turn: float  # largest turn in a step [rad]
    free_turn_rate: float  # turn rate of a robot that drives sideways; NaN for any [rad/s]


def initial_guess(
    settings: LawSettings, start: PlanStart, target: Target, durations: Array
) -> Array:
    """First control history ``(N + 1, r)`` for steps ``(N,)`` [s], by `settings.initial_guess`."""
    if settings.initial_guess.type == 'constant':
        controls = np.empty((len(durations) + 1, 2))
        controls[:] = settings.initial_guess.wheel_speeds
        return controls
    return along_road(settings, start, target, durations)


def along_road(settings: LawSettings, start: PlanStart, target: Target, durations: Array) -> Array:
    """Pursuit of a point ahead on the centre line, at the goal in time, as of `initial_guess`."""
    controls, poses = _empty(start, durations)
    road, heading = start.world.road_space, target.heading
    pursuit = Pursuit(
        start.robot.kinematics, largest_turn(settings), free_turn_rate(start, target, durations)
    )
    heading = math.nan if heading is None else heading
    progress = float(start.progress)
    _follow_road(controls, poses, durations, road, target.position, heading, pursuit, progress)
    return controls


def follow_profile(
    settings: LawSettings,
    start: PlanStart,
    durations: Array,
    frame: RoadFrame,
    profile: Array,
    free_turn_rate: float = 0.0,
    backward: float | None = None,
) -> Array:
    """Pursuit of a point ahead on a path, paced to be at its end in time; shape ``(N + 1, r)``.

    With a limit of acceleration no wheel changes faster, and a robot at rest turns on the spot
    first. So does one that has driven `backward` [m] along the path. The `profile` ``(K,)`` are
    lateral positions of the path at the stations of the frame [m].
    """
    left = np.zeros(len(profile))
    left[:-1] = np.cumsum(lengths(frame, profile)[::-1])[::-1]
    change = turn_change = math.inf
    if isinstance(start.robot, DifferentialDrive):
        change = settings.max_wheel_change
        turn_change = change * start.robot.wheel_radius / start.robot.half_track
    turns_first = backward is not None or (change < math.inf and not start.previous_control.any())
    controls, poses = _empty(start, durations)
    _follow(
        controls,
        poses,
        durations,
        frame,
        np.ascontiguousarray(profile),
        left,
        Pursuit(start.robot.kinematics, largest_turn(settings), free_turn_rate),
        np.ascontiguousarray(start.previous_control, dtype=np.float64),
        (float(change), float(turn_change)),
        _SPOT if turns_first else math.inf,
        backward or 0.0,
    )
    return controls


def free_turn_rate(start: PlanStart, target: Target, durations: Array) -> float:
    """Turn rate to the heading of a goal [rad/s], for a robot that drives sideways; NaN for any."""
    if target.heading is None or target.is_line or not start.robot.drives_sideways:
        return math.nan
    return wrapped(target.heading - float(start.pose[2])) / float(durations.sum())


def largest_turn(settings: LawSettings) -> float:
    """Largest turn of a guess in one step [rad]."""
    return settings.solver.heading_trust_region or math.pi / 2.0


def _empty(start: PlanStart, durations: Array) -> tuple[Array, Array]:
    """Arrays for controls ``(N + 1, r)`` and poses ``(N + 1, 3)`` from the start."""
    controls = np.empty((len(durations) + 1, start.robot.n_controls))
    poses = np.empty((len(durations) + 1, 3))
    poses[0] = start.pose
    return controls, poses


@allocation_free
def _follow_road(
    controls: Array,
    poses: Array,
    durations: Array,
    road: RoadSpace,
    goal: tuple[float, float],
    goal_heading: float,
    pursuit: Pursuit,
    progress: float,
) -> None:
    """Fill the controls, step by step along the poses that they lead to."""
    steps = durations.shape[0]
    left = 0.0
    for k in range(steps):
        left += durations[k]
    progress = road_functions.project(road, poses[0, 0], poses[0, 1], poses[0, 2], progress)
    at_goal = road_functions.project(road, goal[0], goal[1], goal_heading, math.nan)
    for k in range(steps):
        x, y, top = poses[k, 0], poses[k, 1], pursuit.robot.max_speed
        progress = road_functions.lateral_error(road, 0, x, y, progress)[0]
        target_x, target_y, speed = _lookahead(road, x, y, progress, goal, at_goal, left, top)
        steer(controls, poses, k, durations[k], target_x - x, target_y - y, speed, pursuit)
        left -= durations[k]
    for a in range(controls.shape[1]):
        controls[steps, a] = controls[steps - 1, a]


@allocation_free
def _lookahead(
    road: RoadSpace,
    x: float,
    y: float,
    progress: float,
    goal: tuple[float, float],
    at_goal: float,
    left: float,
    top_speed: float,
) -> Any:
    """Point to pursue [m, m] and the speed that gets there in the time left [m/s]."""
    length = road_functions.arc_length_to(road, x, y, progress, goal[0], goal[1], at_goal)
    remaining = abs(length)
    speed = min(remaining / left, top_speed)
    ahead = max(_ROAD_LOOKAHEAD * speed, SHORTEST_LOOKAHEAD)
    if remaining <= ahead:
        speed = min(math.hypot(goal[0] - x, goal[1] - y) / left, top_speed)
        return goal[0], goal[1], speed
    length = math.copysign(ahead, length)
    target_x, target_y = road_functions.point_ahead(road, x, y, progress, length, goal)
    return target_x, target_y, speed


@allocation_free
def _follow(
    controls: Array,
    poses: Array,
    durations: Array,
    frame: RoadFrame,
    profile: Array,
    left_from: Array,
    pursuit: Pursuit,
    previous: Array,
    max_changes: tuple[float, float],
    spot: float,
    backward: float,
) -> None:
    """Fill the controls, step by step; the largest changes are of wheel speed and turn rate."""
    steps, end, robot = durations.shape[0], frame.step * (profile.shape[0] - 1), pursuit.robot
    max_change, max_turn_change = max_changes
    at, _, bearing = locate(frame, poses[0, 0], poses[0, 1], 0.0, frame.begin)
    left = 0.0
    for k in range(steps):
        left += durations[k]
    for k in range(steps):
        speed = min(max(_interpolate(left_from, frame.step, at), 0.0) / left, robot.max_speed)
        ahead = max(_PATH_LOOKAHEAD * speed, SHORTEST_LOOKAHEAD)
        stretch = stretch_at(frame, at, _interpolate(profile, frame.step, at))
        there = at + ahead / max(stretch, SHORTEST_LOOKAHEAD)
        lateral = _interpolate(profile, frame.step, there)
        x, y = point_at(frame, min(there, end), lateral)
        x, y = x - poses[k, 0], y - poses[k, 1]
        angle = wrapped(math.atan2(y, x) - poses[k, 2])
        if max(at, 0.0) < backward and abs(angle) > math.pi / 2.0:
            # A circle through the point, backward.
            speed = -min(speed, _BACKWARD * robot.max_speed)
            turn = 2.0 * speed * math.sin(angle) * durations[k] / max(math.hypot(x, y), 1e-9)
            turn = min(max(turn, -pursuit.max_turn), pursuit.max_turn)
            steer_by(controls, k, speed, 0.0, turn / durations[k], 0.0, robot)
            within_limits(controls, k, robot)
        elif abs(angle) <= spot:
            spot = math.inf
            steer(controls, poses, k, durations[k], x, y, speed, pursuit)
        else:
            # The wheels brake as they have set out: by half of the angle each.
            most = math.sqrt(max_turn_change * durations[k] * abs(angle))
            turn = math.copysign(min(abs(angle), pursuit.max_turn, most), angle)
            steer_by(controls, k, 0.0, 0.0, turn / durations[k], 0.0, robot)
        if max_change < math.inf:
            for side in range(2):
                before = previous[side] if k == 0 else controls[k - 1, side]
                within = max(controls[k, side], before - max_change)
                controls[k, side] = min(within, before + max_change)
        drive(poses, controls, k, durations[k], robot)
        at, _, bearing = locate(frame, poses[k + 1, 0], poses[k + 1, 1], at, bearing)
        left = max(left - durations[k], 1e-9)
    for a in range(controls.shape[1]):
        controls[steps, a] = controls[steps - 1, a]


@allocation_free
def _interpolate(table: Array, step: float, at: float) -> float:
    place = min(max(at / step, 0.0), table.shape[0] - 1.0)
    k = min(int(place), table.shape[0] - 2)
    between: float = table[k] + (place - k) * (table[k + 1] - table[k])
    return between


@allocation_free
def steer(
    controls: Array,
    poses: Array,
    k: int,
    duration: float,
    x: float,
    y: float,
    speed: float,
    pursuit: Pursuit,
) -> None:
    """Fill control ``k`` and the pose after it: the arc from pose ``k`` through a point.

    A circle through the robot and a point at distance ``d`` and angle ``a`` has the curvature
    ``2 sin(a) / d``. The point (x, y) is relative to the pose [m], the speed that along the arc.
    """
    robot, distance = pursuit.robot, max(math.hypot(x, y), SHORTEST_LOOKAHEAD)
    angle = wrapped(math.atan2(y, x) - poses[k, 2])
    trusted = pursuit.max_turn / duration
    if robot.drives_sideways:
        is_free = math.isnan(pursuit.free_turn_rate)
        turn_rate = 0.0 if is_free else min(max(pursuit.free_turn_rate, -trusted), trusted)
        _drive_sideways(controls, k, duration, angle, speed, robot, turn_rate)
        if is_free and fastest_wheel(controls, k, robot) > robot.max_wheel_speed:
            # Sideways it is slower than ahead: it turns to its course.
            turn_rate = min(max(angle / duration, -trusted), trusted)
            _drive_sideways(controls, k, duration, angle, speed, robot, turn_rate)
    else:
        is_ahead = abs(angle) < math.pi / 2.0
        if robot.max_curvature == math.inf:
            bend = math.sin(angle) if is_ahead else math.copysign(1.0, angle)
            turn_rate = min(max(2.0 * speed * bend / distance, -trusted), trusted)
            curvature = 0.0
        else:
            # As sharply as possible towards a point beside or behind.
            wanted = 2.0 * math.sin(abs(angle)) / distance if is_ahead else math.inf
            tightest = min(robot.max_curvature, trusted / max(speed, 1e-12))
            curvature = math.copysign(min(wanted, tightest), angle)
            turn_rate = speed * curvature
        steer_by(controls, k, speed, 0.0, turn_rate, curvature, robot)
    within_limits(controls, k, robot)
    drive(poses, controls, k, duration, robot)


@allocation_free
def _drive_sideways(
    controls: Array,
    k: int,
    duration: float,
    angle: float,
    speed: float,
    robot: Kinematics,
    turn_rate: float,
) -> None:
    """Fill the control of a robot that goes at an angle while it turns."""
    course = angle - turn_rate * duration / 2.0
    forward, left = speed * math.cos(course), speed * math.sin(course)
    steer_by(controls, k, forward, left, turn_rate, 0.0, robot)
