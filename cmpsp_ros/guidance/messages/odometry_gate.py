"""Plausibility of odometry: in the order of time, and within the limits of the wheels."""

import math
from enum import Enum, auto
from typing import Any, Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.messages.poses import OdometryError, check_age
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS, to_nanoseconds
from cmpsp_ros.robots import Robot

_OVERSPEED: Final = 1.25  # ratio of the speed that odometry may show to the limit of the wheels
_TURN_PER_METER: Final = 2.0  # tolerated jump of the heading for one of the position [rad/m]


class Arrival(Enum):
    """Outcome of a message without a fault."""

    TAKEN = auto()
    IGNORED = auto()
    TIME_JUMPED_BACK = auto()


class OdometryGate:
    """Compares each odometry message with the one before.

    After a fault the robot may go on once it was stopped and odometry of a period consistent.
    """

    def __init__(self) -> None:
        self.fault = ''  # the last one, a sentence; empty once the robot may go on
        self.newest: int | None = None  # stamp of the newest odometry taken [ns]
        self.counts = {'refused': 0, 'out_of_order': 0, 'repeated': 0}
        self._pose: Array | None = None
        self._consistent_since: int | None = None
        self._is_stopped = False

    def fail(self, reason: str) -> None:
        """Set the fault, a sentence."""
        self._is_stopped = self._is_stopped and bool(self.fault)
        self.fault, self._consistent_since = reason, None

    def note_stop(self) -> None:
        """Record that a stop was commanded."""
        self._is_stopped = True

    def refuse(self, reason: str) -> None:
        """Count an unusable message, which is a fault; the reason is a sentence."""
        self.counts['refused'] += 1
        self.fail(reason)

    def reason(self, settings: LawSettings) -> str:
        """Reason to stop, in sentences; empty if there is none."""
        if not self.fault or self._consistent_since is None:
            return self.fault
        waits = (
            f'Recovering: odometry must be consistent for {settings.control_period} s'
            ' (control_period) before the robot goes on.'
        )
        return f'{waits} {self.fault}'

    def take(self, stamp: int, pose: Array, now: int, settings: LawSettings) -> Arrival:
        """Take a pose ``(3,)`` [m, m, rad] at a time [ns], or OdometryError.

        Time has jumped back where the newest odometry does not fit the clock any more.
        """
        before = stamp if self.newest is None else self.newest
        pose_before = pose if self._pose is None else self._pose
        arrival, duration = Arrival.TAKEN, abs(stamp - before) / NANOSECONDS
        if stamp < before:
            if before - max(stamp, now) <= to_nanoseconds(settings.odom_timeout):
                self.counts['out_of_order'] += 1
                if self.fault:
                    # Of two sources the one whose stamps are newer is not the more credible.
                    _check_motion(pose_before, pose, duration, settings)
                return Arrival.IGNORED
            arrival = Arrival.TIME_JUMPED_BACK
        check_age('Odometry is', 'odom_timeout', stamp, now, settings.odom_timeout, OdometryError)
        self.counts['repeated'] += stamp == self.newest
        self.newest, self._pose = stamp, pose
        if arrival is Arrival.TIME_JUMPED_BACK:
            self.fault = ''
        else:
            _check_motion(pose_before, pose, duration, settings)
        if self.fault:
            since = stamp if self._consistent_since is None else self._consistent_since
            self._consistent_since = since
            if self._is_stopped and stamp - since >= to_nanoseconds(settings.control_period):
                self.fault = ''
        return arrival


def motion_limits(robot: Robot, duration: Any, max_jump: float) -> tuple[Any, Any]:
    """Distance and turn that odometry may show within a duration [s], of any shape [m, rad]."""
    distance = _OVERSPEED * robot.max_speed * duration
    return distance + max_jump, distance / robot.half_track + _TURN_PER_METER * max_jump


def _check_motion(before: Array, after: Array, duration: float, settings: LawSettings) -> None:
    max_jump, robot = settings.safety.max_odom_jump, settings.robot
    if not max_jump or not math.isfinite(robot.max_speed):
        return
    moved = math.dist(before[:2], after[:2])
    turned = abs(math.remainder(float(after[2] - before[2]), math.tau))
    limits = motion_limits(robot, duration, max_jump)
    for found, limit, unit in zip((moved, turned), limits, ('m', 'rad'), strict=True):
        if found > limit:
            raise OdometryError(
                f'Odometry jumps by {found:.3g} {unit} within {duration:.3f} s: the wheels allow'
                f' {limit:.3g} {unit} (safety.max_odom_jump).'
            )
