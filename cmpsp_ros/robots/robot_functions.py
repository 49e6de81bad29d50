"""The models of robots for compiled code, told apart by a run-time tag."""

from __future__ import annotations

import math

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import ackermann_functions as ackermann
from cmpsp_ros.robots import differential_drive_functions as differential_drive
from cmpsp_ros.robots import omnidirectional_functions as omnidirectional
from cmpsp_ros.robots.arcs import Arc, arc_from
from cmpsp_ros.robots.kinematics import ACKERMANN, OMNIDIRECTIONAL, OWN, Kinematics
from cmpsp_ros.robots.own import functions as own
from cmpsp_ros.robots.own.functions import MOTION


@allocation_free
def drive(poses: Array, controls: Array, k: int, duration: float, robot: Kinematics) -> None:
    """Pose ``k + 1`` from pose ``k``: one exact arc."""
    if robot.model == OMNIDIRECTIONAL:
        omnidirectional.drive(poses, controls, k, duration, robot.twists)
    elif robot.model == ACKERMANN:
        ackermann.drive(poses, controls, k, duration, robot.gain, robot.arm)
    elif robot.model >= OWN:
        own.drive(poses, controls, k, duration, robot)
    else:
        differential_drive.drive(poses, controls, k, duration, robot.gain, robot.arm)


@allocation_free
def put_gradients(
    A: Array, B: Array, heading: float, controls: Array, k: int, duration: float, robot: Kinematics
) -> None:
    """Fill the derivatives of `drive` by pose and control, those that are not always 0."""
    for i in range(3):
        A[i, i] = 1.0
    if robot.model == OMNIDIRECTIONAL:
        omnidirectional.put_gradients(A, B, heading, controls, k, duration, robot.twists)
        return
    if robot.model == ACKERMANN:
        ackermann.put_gradients(A, B, heading, controls, k, duration, robot.gain, robot.arm)
        return
    if robot.model >= OWN:
        own.put_gradients(A, B, heading, controls, k, duration, robot)
        return
    right, left = controls[k, 0], controls[k, 1]
    A[0, 2], A[1, 2], B[0, 0], B[0, 1], B[1, 0], B[1, 1], turn = differential_drive.gradients(
        heading, right, left, duration, robot.gain, robot.arm
    )
    B[2, 0], B[2, 1] = turn, -turn


@allocation_free
def arc_of(
    x: float, y: float, heading: float, controls: Array, k: int, duration: float, robot: Kinematics
) -> Arc:
    """The arc that a control leads along from a pose."""
    if robot.model == OMNIDIRECTIONAL:
        forward, left, turn_rate = omnidirectional.twist_of(controls, k, robot.twists)
        course = heading + math.atan2(left, forward)
        return arc_from(x, y, course, math.hypot(forward, left) * duration, turn_rate * duration)
    if robot.model >= OWN:
        own.find(robot, MOTION, controls, k)
        forward, left, turn_rate = robot.scratch[0, 0], robot.scratch[0, 1], robot.scratch[0, 2]
        course, length = heading + math.atan2(left, forward), math.hypot(forward, left) * duration
        return arc_from(x, y, course, length, turn_rate * duration)
    if robot.model == ACKERMANN:
        length = controls[k, 0] * robot.gain * duration
        return arc_from(x, y, heading, length, length * math.tan(controls[k, 1]) / robot.arm)
    right, left = controls[k, 0] * robot.gain, controls[k, 1] * robot.gain
    length = (right + left) / 2.0 * duration
    turn = (right - left) / (2.0 * robot.arm) * duration
    return arc_from(x, y, heading, length, turn)


@allocation_free
def fastest_wheel(controls: Array, k: int, robot: Kinematics) -> float:
    """Speed of the wheel that a control turns fastest [rad/s]."""
    fastest = 0.0
    for i in range(robot.wheels.shape[0]):
        speed = 0.0
        for a in range(controls.shape[1]):
            speed += robot.wheels[i, a] * controls[k, a]
        # `max` drops NaN, a sum propagates it.
        fastest = max(fastest, abs(speed)) + 0.0 * speed
    return fastest


@allocation_free
def roll_out(poses: Array, controls: Array, durations: Array, robot: Kinematics) -> None:
    """Fill the poses after the first; the model is asked for once, as this is done often."""
    gain, arm = robot.gain, robot.arm
    if robot.model == OMNIDIRECTIONAL:
        for k in range(durations.shape[0]):
            omnidirectional.drive(poses, controls, k, durations[k], robot.twists)
    elif robot.model == ACKERMANN:
        for k in range(durations.shape[0]):
            ackermann.drive(poses, controls, k, durations[k], gain, arm)
    elif robot.model >= OWN:
        for k in range(durations.shape[0]):
            own.drive(poses, controls, k, durations[k], robot)
    else:
        for k in range(durations.shape[0]):
            differential_drive.drive(poses, controls, k, durations[k], gain, arm)


@allocation_free
def put_jacobians(
    A: Array, B: Array, poses: Array, controls: Array, durations: Array, robot: Kinematics
) -> None:
    """Fill the derivatives of every step of `roll_out`."""
    for k in range(durations.shape[0]):
        put_gradients(A[k], B[k], poses[k, 2], controls, k, durations[k], robot)
