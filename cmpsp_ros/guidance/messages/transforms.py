"""Planar transforms between frames, from `/tf`."""

import math
from bisect import bisect_right
from collections import deque
from functools import reduce
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.messages.poses import compose, heading_of
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.sensing import stamp_of

_MAX_KEPT: Final = 1000  # transforms of a frame that are remembered
_JUMP: Final = NANOSECONDS // 2  # time by which stamps go back where time has jumped back [ns]
_OVER: Final = NANOSECONDS // 10  # time over which the motion of a frame is measured [ns]
_UPRIGHT: Final = math.cos(math.radians(20.0))  # least cosine of the tilt of a planar frame


class TransformError(ValueError):
    """A transform is not known; the message names the frames, and says why."""


class _Known(NamedTuple):
    """Poses of a frame in its parent at some instants [ns]."""

    parent: str
    is_static: bool
    stamps: deque[int]
    poses: deque[Array]  # with the cosine of its tilt, each of shape ``(4,)``

    def forget(self) -> None:
        self.stamps.clear()
        self.poses.clear()


class Transforms:
    """Buffer of transforms."""

    def __init__(self) -> None:
        self._known: dict[str, _Known] = {}

    def add(self, message: Any, *, is_static: bool = False) -> None:
        """Add a `tf2_msgs/TFMessage`, but for transforms not finite; later ones are forgotten.

        Where time has jumped back, so are all.
        """
        for each in message.transforms:
            parent, child, stamp = each.header.frame_id, each.child_frame_id, stamp_of(each)
            moved, turned = each.transform.translation, each.transform.rotation
            pose = np.array([moved.x, moved.y, heading_of(turned), _uprightness(turned)])
            known = self._known.get(child)
            if known is None or (known.parent, known.is_static) != (parent, is_static):
                known = _Known(parent, is_static, deque(maxlen=_MAX_KEPT), deque(maxlen=_MAX_KEPT))
                self._known[child] = known
            if np.isfinite(pose).all():
                if known.stamps and known.stamps[-1] - stamp > _JUMP:
                    known.forget()
                while known.stamps and known.stamps[-1] >= stamp:
                    known.stamps.pop()
                    known.poses.pop()
                known.stamps.append(stamp)
                known.poses.append(pose)

    def forget_after(self, stamp: int) -> None:
        """Forget frames known later than an instant [ns], to which time has jumped back."""
        for each in self._known.values():
            if not each.is_static and each.stamps and each.stamps[-1] - stamp > _JUMP:
                each.forget()

    def look_up(self, target: str, source: str, stamp: int, timeout: float) -> Array:
        """Pose ``(3,)`` of the source frame in the target frame at `stamp` [ns], 0 for the latest.

        Interpolated; TransformError if the nearest is farther away than `timeout` [s].
        """
        to_target, to_source = (
            reduce(
                lambda pose, frame: compose(self._at(frame, stamp, timeout), pose),
                chain,
                np.zeros(3),
            )
            for chain in self._chains(target, source)
        )
        x, y, heading = -to_target
        back = compose(np.array([0.0, 0.0, heading]), np.array([x, y, 0.0]))
        return compose(back, to_source)

    def motion(self, target: str, source: str, stamp: int, timeout: float) -> tuple[Array, Array]:
        """Pose as `look_up` and velocity ``(3,)`` [m/s, m/s, rad/s], the last known until `stamp`.

        The pose is carried on with it; TransformError where less than 0.1 s is known.
        """
        self.look_up(target, source, stamp, timeout)
        frames = [each for chain in self._chains(target, source) for each in chain]
        known = [self._known[each].stamps for each in frames if not self._known[each].is_static]
        newest = min([stamp, *(each[-1] for each in known)])
        if any(newest - each[0] < _OVER for each in known):
            wanted = f'wanted {_OVER / NANOSECONDS} s, for its motion'
            raise TransformError(
                f'{source!r} is known in {target!r} for too short a time, {wanted}'
            )
        there = self.look_up(target, source, newest, timeout)
        change = there - self.look_up(target, source, newest - _OVER, timeout)
        change[2] = math.remainder(change[2], math.tau)
        there = there + change * ((stamp - newest) / _OVER)
        there[2] = math.remainder(there[2], math.tau)
        return there, change * (NANOSECONDS / _OVER)

    def _chains(self, target: str, source: str) -> list[list[str]]:
        """Frames from each of both up to the first one that they share, without that."""
        chains = [self._ancestors(each) for each in (target, source)]
        common = next((each for each in chains[1] if each in chains[0]), None)
        if common is None:
            raise TransformError(
                f'no transform from {source!r} to {target!r} has come on /tf or /tf_static'
            )
        return [chain[: chain.index(common)] for chain in chains]

    def _ancestors(self, frame: str) -> list[str]:
        """Frames from this one up to the root of its tree."""
        chain = [frame]
        while (known := self._known.get(chain[-1])) is not None and known.stamps:
            if known.parent in chain:
                raise TransformError(f'the transforms lead in a circle at {known.parent!r}')
            chain.append(known.parent)
        return chain

    def _at(self, frame: str, stamp: int, timeout: float) -> Array:
        """Pose of a frame in its parent; TransformError if it is tilted there."""
        *pose, up = self._near(frame, stamp, timeout)
        if up < _UPRIGHT:
            tilt = math.degrees(math.acos(max(up, -1.0)))
            parent = self._known[frame].parent
            raise TransformError(
                f'{frame!r} is tilted by {tilt:.0f} deg in {parent!r}, wanted its z axis up'
            )
        return np.array(pose)

    def _near(self, frame: str, stamp: int, timeout: float) -> Array:
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


def _uprightness(q: Any) -> float:
    """Cosine of the angle between the z axes of a frame and its parent, by a quaternion."""
    length = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z
    up = q.w * q.w + q.z * q.z - q.x * q.x - q.y * q.y
    return float(up / length) if length > 0.0 else math.nan
