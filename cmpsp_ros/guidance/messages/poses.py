"""Poses in messages, the checks that all messages share, and transforms from `/tf`."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from functools import reduce
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Goal, GoalError
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.sensing import is_place, stamp_of

RECEIVED: Final = 'goal_pose'  # name of a goal that is received during a run
_MAX_KEPT: Final = 1000  # transforms of a frame that are remembered


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


class TransformError(ValueError):
    """A transform is not known; the message names the frames, and says why."""


class _Known(NamedTuple):
    """Poses of a frame in its parent at some instants [ns]."""

    parent: str
    is_static: bool
    stamps: deque[int]
    poses: deque[Array]


class Transforms:
    """Buffer of transforms."""

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}

    def add(self, message: Any, *, is_static: bool = False) -> None:
        """Add a `tf2_msgs/TFMessage`, but for transforms not finite; later ones are forgotten."""
        for each in message.transforms:
            parent, child, stamp = each.header.frame_id, each.child_frame_id, stamp_of(each)
            moved, turned = each.transform.translation, each.transform.rotation
            pose = np.array([moved.x, moved.y, heading_of(turned)])
            known = self._known.get(child)
            if known is None or (known.parent, known.is_static) != (parent, is_static):
                known = _Known(parent, is_static, deque(maxlen=_MAX_KEPT), deque(maxlen=_MAX_KEPT))
                self._known[child] = known
            if np.isfinite(pose).all():
                while known.stamps and known.stamps[-1] >= stamp:
                    known.stamps.pop()
                    known.poses.pop()
                known.stamps.append(stamp)
                known.poses.append(pose)

    def look_up(self, target: str, source: str, stamp: int, timeout: float) -> Array:
        """Pose ``(3,)`` of the source frame in the target frame at `stamp` [ns], 0 for the latest.

        Interpolated; TransformError if the nearest is farther away than `timeout` [s].
        """
        chains = [self._ancestors(each) for each in (target, source)]
        common = next((each for each in chains[1] if each in chains[0]), None)
        if common is None:
            raise TransformError(
                f'no transform from {source!r} to {target!r} has come on /tf or /tf_static'
            )
        to_target, to_source = (
            reduce(
                lambda pose, frame: compose(self._at(frame, stamp, timeout), pose),
                chain[: chain.index(common)],
                np.zeros(3),
            )
            for chain in chains
        )
        x, y, heading = -to_target
        back = compose(np.array([0.0, 0.0, heading]), np.array([x, y, 0.0]))
        return compose(back, to_source)

    def _ancestors(self, frame: str) -> list[str]:
        """Frames from this one up to the root of its tree."""
        chain = [frame]
        while (known := self._known.get(chain[-1])) is not None and known.stamps:
            if known.parent in chain:
                raise TransformError(f'the transforms lead in a circle at {known.parent!r}')
            chain.append(known.parent)
        return chain

    def _at(self, frame: str, stamp: int, timeout: float) -> Array:
        """Pose of a frame in its parent."""
        parent, is_static, stamps, poses = self._known[frame]
        if is_static or stamp == 0:
            return poses[-1]
        after = bisect_right(stamps, stamp)
        if 0 < after < len(stamps):
            before, later = poses[after - 1], poses[after]
            fraction = (stamp - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
            change = later - before
            change[2] = math.remainder(change[2], math.tau)
            return np.asarray(before + fraction * change)
        nearest = max(after - 1, 0)
        off = abs(stamp - stamps[nearest]) / NANOSECONDS
        if off > timeout:
            raise TransformError(
                f'the transform from {frame!r} to {parent!r} is {off:.3f} s off (odom_timeout)'
            )
        return poses[nearest]


def compose(first: Array, second: Array) -> Array:
    """A pose in a frame whose own pose is given, each of shape ``(3,)`` [m, m, rad]."""
    cosine, sine = math.cos(first[2]), math.sin(first[2])
    x, y = cosine * second[0] - sine * second[1], sine * second[0] + cosine * second[1]
    heading = math.remainder(first[2] + second[2], math.tau)
    return np.array([first[0] + x, first[1] + y, heading])
