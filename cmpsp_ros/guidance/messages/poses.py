"""Poses in messages, and the checks that all messages share."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Goal, GoalError
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.sensing import is_place, stamp_of

RECEIVED: Final = 'goal_pose'  # name of a goal that is received during a run


class OdometryError(ValueError):
    """Unusable odometry; the message says why."""


class OdometryReading(NamedTuple):
    """A `nav_msgs/Odometry` as far as it is used (REP-105)."""

    stamp: int  # [ns]
    frame_id: str  # of the pose
    child_frame_id: str  # frame whose pose it is
    position: tuple[float, float]  # (x, y) [m]
    orientation: tuple[float, float, float, float]  # (x, y, z, w)

    @classmethod
    def of(cls, message: Any) -> OdometryReading:
        """The reading in a message."""
        position, q = message.pose.pose.position, message.pose.pose.orientation
        frames = message.header.frame_id, message.child_frame_id
        return cls(stamp_of(message), *frames, (position.x, position.y), (q.x, q.y, q.z, q.w))

    def pose_in(self, frame_id: str) -> Array:
        """Planar pose ``(x, y, heading)`` [m, m, rad] in a frame, or OdometryError."""
        check_frame('Odometry is', self.frame_id, frame_id, OdometryError)
        (x, y), length = self.position, math.sqrt(sum(each * each for each in self.orientation))
        if abs(length - 1.0) > 0.01:
            raise OdometryError(f'Odometry has an orientation of length {length:.3g}, wanted 1.')
        pose = (x, y, _heading(*self.orientation))
        if not all(map(math.isfinite, pose)):
            raise OdometryError(f'Odometry has a pose that is not finite: {list(pose)}.')
        if not is_place(x, y):
            raise OdometryError(
                f'Odometry has a position of {x:.3g}, {y:.3g} m, wanted one on Earth.'
            )
        return np.array(pose)


def goal_of(message: Any, frame_id: str) -> tuple[int, Goal]:
    """Time stamp [ns] and goal of a PoseStamped without its time; zeros mean any orientation.

    GoalError if it is in another frame, is not finite, or has an orientation that is none.
    """
    check_frame('The goal is', message.header.frame_id, frame_id, GoalError)
    position, q = message.pose.position, message.pose.orientation
    length = math.hypot(q.x, q.y, q.z, q.w)
    heading = None if length == 0.0 else heading_of(q)
    values = (position.x, position.y, heading or 0.0, length)
    if not all(map(math.isfinite, values)):
        raise GoalError(f'The goal is not finite: {[position.x, position.y, heading]}.')
    if not is_place(position.x, position.y):
        raise GoalError(
            f'The goal is at {position.x:.3g}, {position.y:.3g} m, wanted one on Earth.'
        )
    if heading is not None and abs(length - 1.0) > 0.01:
        raise GoalError(
            f'The goal has an orientation of length {length:.3g}, wanted 1, or 0 for any.'
        )
    return stamp_of(message), Goal((position.x, position.y), 0.0, heading, RECEIVED)


def heading_of(orientation: Any) -> float:
    """Heading of a quaternion of any length but 0 [rad]."""
    return _heading(orientation.x, orientation.y, orientation.z, orientation.w)


def _heading(x: float, y: float, z: float, w: float) -> float:
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def check_frame(subject: str, found: str, wanted: str, error: type[ValueError]) -> None:
    """Raise an error for a message in another frame; the subject includes the verb."""
    if found != wanted:
        raise error(f'{subject} in frame {found!r}, wanted {wanted!r} (frame_id).')


def check_age(
    subject: str, key: str, stamp: int, now: int, timeout: float, error: type[ValueError]
) -> None:
    """Raise `error` if a stamp [ns] differs from the clock by more than the time-out [s].

    `subject` has its verb, `key` names the time-out.
    """
    age = (now - stamp) / NANOSECONDS
    if age > timeout:
        raise error(f'{subject} {age:.3f} s old ({key} {timeout} s); is use_sim_time right?')
    if -age > timeout:
        raise error(
            f'{subject} {-age:.3f} s ahead of the clock ({key} {timeout} s); is use_sim_time right?'
        )


def compose(first: Array, second: Array) -> Array:
    """A pose in a frame whose own pose is given, each of shape ``(3,)`` [m, m, rad]."""
    cosine, sine = math.cos(first[2]), math.sin(first[2])
    x, y = cosine * second[0] - sine * second[1], sine * second[0] + cosine * second[1]
    heading = math.remainder(first[2] + second[2], math.tau)
    return np.array([first[0] + x, first[1] + y, heading])
