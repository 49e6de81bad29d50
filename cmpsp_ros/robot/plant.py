"""A stand-in for the robot: velocity commands in, the path driven and noisy odometry out.

Nothing here reads a clock: time is an argument in integer nanoseconds, so a run repeats exactly.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.robot.differential_drive import DifferentialDrive

Array = NDArray[np.float64]

_NS = 1_000_000_000


class TwistError(ValueError):
    """A commanded twist that no wheel can follow because it is not a number."""


@dataclass(frozen=True)
class PlantSettings:
    """All that the simulated robot depends on.

    Attributes:
        robot: Wheel radius, half track and wheel-speed limit.
        initial_pose: Pose at the start and after a reset (x, y, heading) [m, m, rad].
        odom_rate: Odometry messages a second [Hz].
        cmd_vel_timeout: Time for which a command holds once it has taken effect [s]; 0 means for
            ever.
        actuation_delay: Time from a command to its effect [s].
        position_stddev: Standard deviation of measured x and of measured y [m].
        heading_stddev: Standard deviation of the measured heading [rad].
        seed: Of the noise.
    """

    robot: DifferentialDrive
    initial_pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    odom_rate: float = 50.0
    cmd_vel_timeout: float = 0.5
    actuation_delay: float = 0.0
    position_stddev: float = 0.0
    heading_stddev: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Motion:
    """Where the robot is at an instant, and how it moves from there on.

    Attributes:
        stamp_ns: The instant [ns].
        pose: Shape ``(3,)`` [m, m, rad]; the heading is not wrapped.
        wheel_speeds: Right and left, shape ``(2,)`` [rad/s].
        twist: Shape ``(2,)`` [m/s, rad/s].
    """

    stamp_ns: int
    pose: Array
    wheel_speeds: Array
    twist: Array


class Plant:
    """The robot between commands, in closed form.

    Every pose is computed from the last change of wheel speeds, not from the last call: how finely
    time is advanced makes no difference, not even in the last bit.
    """

    def __init__(self, settings: PlantSettings, start_ns: int = 0) -> None:
        """Put the robot at its initial pose, at rest.

        Args:
            settings: What it depends on.
            start_ns: Time at which it stands there [ns].
        """
        self._settings = settings
        self._now_ns = self._heard_ns = start_ns
        self.reset()

    @property
    def stamp_ns(self) -> int:
        """Time reached [ns]."""
        return self._now_ns

    @property
    def pose(self) -> Array:
        """True pose, shape ``(3,)`` [m, m, rad]; the heading is not wrapped."""
        return self._pose_at(self._now_ns)

    @property
    def wheel_speeds(self) -> Array:
        """Right and left, shape ``(2,)`` [rad/s]."""
        return self._wheel_speeds.copy()

    @property
    def twist(self) -> Array:
        """Twist driven, after the wheel limits, shape ``(2,)`` [m/s, rad/s]."""
        return self._settings.robot.twist(self._wheel_speeds)

    @property
    def motion(self) -> Motion:
        """Pose and speeds now."""
        return Motion(self._now_ns, self.pose, self.wheel_speeds, self.twist)

    def reset(self) -> None:
        """Put the robot back to its initial pose, at rest, and begin its noise again.

        Time goes on from where it is. Commands that have not taken effect yet are forgotten.
        """
        self._from_ns = self._heard_ns = self._now_ns
        self._from_pose = np.array(self._settings.initial_pose, dtype=float)
        self._wheel_speeds = np.zeros(2)
        self._expires_ns: int | None = None
        self._pending: deque[tuple[int, Array]] = deque()
        self._noise = np.random.default_rng(self._settings.seed)

    def reconfigure(self, settings: PlantSettings) -> None:
        """Go on under other settings.

        What was commanded before keeps its wheel speeds and the time of its effect, and of its end
        if it has taken effect. Initial pose and seed count from the next reset on.

        Args:
            settings: What the robot depends on from the time reached on.
        """
        self._from_pose, self._from_ns = self.pose, self._now_ns
        self._settings = settings

    def command(self, stamp_ns: int, linear: float, angular: float) -> None:
        """Ask for a twist; it is driven from ``stamp_ns`` plus the actuation delay on.

        It takes effect in `advance`, also when there is no delay.

        Args:
            stamp_ns: When the robot hears the command [ns], not before the time reached.
            linear: Speed along the path [m/s].
            angular: Yaw rate [rad/s].

        Raises:
            TwistError: The twist is not finite; the last one before stays in force.
            ValueError: ``stamp_ns`` lies in the past, or before the command that came last.
        """
        earliest_ns = max(self._now_ns, self._heard_ns)
        if stamp_ns < earliest_ns:
            raise ValueError(f'command at {stamp_ns} ns: expected {earliest_ns} ns or later')
        if not (math.isfinite(linear) and math.isfinite(angular)):
            raise TwistError(f'twist ({linear} m/s, {angular} rad/s): expected finite numbers')
        with np.errstate(over='ignore', invalid='ignore'):
            wheel_speeds = self._settings.robot.wheel_speeds(np.array([linear, angular]))
        if not np.isfinite(wheel_speeds).all():
            raise TwistError(f'twist ({linear} m/s, {angular} rad/s): too large for any wheel')
        self._heard_ns = stamp_ns
        effect_ns = stamp_ns + round(self._settings.actuation_delay * _NS)
        if self._pending:
            # A delay that was shortened lets no command overtake another.
            effect_ns = max(effect_ns, self._pending[-1][0])
        self._pending.append((effect_ns, self._limited(wheel_speeds)))

    def advance(self, stamp_ns: int) -> list[Motion]:
        """Let time pass.

        A command counts as in time when its successor takes effect at the very instant at which it
        expires; for that reason the robot stops only once time has gone past that instant.

        Args:
            stamp_ns: Time to reach [ns], not before the time reached.

        Returns:
            The motion at each change of wheel speeds on the way (a command takes effect, or
            expires), in order: with them the whole path can be drawn again.

        Raises:
            ValueError: ``stamp_ns`` lies in the past.
        """
        if stamp_ns < self._now_ns:
            raise ValueError(f'advance to {stamp_ns} ns: expected {self._now_ns} ns or later')
        changes: list[Motion] = []
        while True:
            effect_ns = self._pending[0][0] if self._pending else math.inf
            expires_ns = math.inf if self._expires_ns is None else self._expires_ns
            if effect_ns <= min(stamp_ns, expires_ns):
                instant_ns, wheel_speeds = self._pending.popleft()
                self._change(instant_ns, wheel_speeds, self._expiry(instant_ns))
            elif self._expires_ns is not None and self._expires_ns < stamp_ns:
                self._change(self._expires_ns, np.zeros(2), None)
            else:
                break
            changes.append(self.motion)
        self._now_ns = stamp_ns
        return changes

    def measured_pose(self) -> Array:
        """Pose with noise, shape ``(3,)`` [m, m, rad]; every call draws the next noise."""
        position, heading = self._settings.position_stddev, self._settings.heading_stddev
        noise = self._noise.standard_normal(3) * np.array([position, position, heading])
        measured: Array = self.pose + noise
        return measured

    def _change(self, stamp_ns: int, wheel_speeds: Array, expires_ns: int | None) -> None:
        self._from_pose = self._pose_at(stamp_ns)
        self._from_ns = self._now_ns = stamp_ns
        self._wheel_speeds = wheel_speeds
        self._expires_ns = expires_ns

    def _pose_at(self, stamp_ns: int) -> Array:
        duration = (stamp_ns - self._from_ns) / _NS
        path = self._settings.robot.roll_out(
            self._from_pose, self._wheel_speeds[np.newaxis], np.array([duration])
        )
        pose: Array = path[1]
        return pose

    def _expiry(self, stamp_ns: int) -> int | None:
        lasts = self._settings.cmd_vel_timeout
        return stamp_ns + round(lasts * _NS) if 0.0 < lasts < math.inf else None

    def _limited(self, wheel_speeds: Array) -> Array:
        fastest = float(np.abs(wheel_speeds).max())
        limit = self._settings.robot.max_wheel_speed
        if fastest <= limit:
            return wheel_speeds
        # Both wheels by one factor keeps the curvature. Divided first: the faster wheel is then
        # exactly 1, its speed exactly the limit, and rounding cannot lift the other above it.
        limited: Array = wheel_speeds / fastest * limit
        return limited
