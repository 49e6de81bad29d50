"""A stand-in for the robot: velocity commands in, the path driven and its odometry out.

Nothing here reads a clock: time is an argument in integer nanoseconds, so a run repeats exactly.
A command waits for its delay, is followed by the wheels with their lag, and moves the robot less
than they turn where they slip. All of this is off by default.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.robot.differential_drive import DifferentialDrive
from cmpsp_ros.robot.measurement import Measurement, OdometryErrors
from cmpsp_ros.robot.streams import Stream, generator
from cmpsp_ros.robot.wheel_lag import SLICE_NS, LaggedWheels

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
        actuation_jitter: Longest time that a command takes beyond it, evenly distributed [s].
        wheel_lag: Time constant with which the wheels follow a command [s].
        wheel_slip: Part of its turning by which each wheel (right, left) fails to move the robot.
        wheel_slip_stddev: Standard deviation of what is added to it, for each wheel and command.
        odometry: How odometry differs from the truth.
        seed: Of all that is random.
    """

    robot: DifferentialDrive
    initial_pose: tuple[float, float, float] = (0.0, 0.0, 0.0)
    odom_rate: float = 50.0
    cmd_vel_timeout: float = 0.5
    actuation_delay: float = 0.0
    actuation_jitter: float = 0.0
    wheel_lag: float = 0.0
    wheel_slip: tuple[float, float] = (0.0, 0.0)
    wheel_slip_stddev: float = 0.0
    odometry: OdometryErrors = field(default_factory=OdometryErrors)
    seed: int = 0


@dataclass(frozen=True)
class Motion:
    """Where the robot is at an instant, and how it moves from there on.

    Attributes:
        stamp_ns: The instant [ns].
        pose: Shape ``(3,)`` [m, m, rad]; the heading is not wrapped.
        wheel_speeds: At which right and left wheel turn, shape ``(2,)`` [rad/s].
        twist: At which the robot moves, shape ``(2,)`` [m/s, rad/s].
    """

    stamp_ns: int
    pose: Array
    wheel_speeds: Array
    twist: Array


@dataclass(frozen=True)
class _Command:
    """A command under way.

    Attributes:
        effect_ns: When it takes effect [ns].
        wheel_speeds: What it asks of the wheels, shape ``(2,)`` [rad/s].
        grip: Part of each wheel's turning that moves the robot under it, shape ``(2,)``.
    """

    effect_ns: int
    wheel_speeds: Array
    grip: Array


class Plant:
    """The robot between commands, in closed form.

    Its path is made of arcs of constant wheel speeds. Every pose is computed from the beginning of
    its arc, not from the last call: how finely time is advanced makes no difference, not even in
    the last bit.
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
        """Speeds at which right and left wheel turn on this arc, shape ``(2,)`` [rad/s]."""
        speeds: Array = self._wheel_speeds.copy()
        return speeds

    @property
    def twist(self) -> Array:
        """Twist driven, after wheel limits, lag and slip, shape ``(2,)`` [m/s, rad/s]."""
        return self._settings.robot.twist(self._wheel_speeds * self._grip)

    @property
    def motion(self) -> Motion:
        """Pose and speeds now."""
        return Motion(self._now_ns, self.pose, self.wheel_speeds, self.twist)

    def reset(self) -> None:
        """Put the robot back to its initial pose, at rest, and begin all that is random again.

        Time goes on from where it is. Commands that have not taken effect yet are forgotten.
        """
        settings = self._settings
        self._start_ns = self._from_ns = self._heard_ns = self._now_ns
        self._from_pose = np.array(settings.initial_pose, dtype=float)
        self._pending: deque[_Command] = deque()
        self._expires_ns: int | None = None
        self._grip = 1.0 - np.array(settings.wheel_slip, dtype=float)
        self._follow(np.zeros(2), np.zeros(2))
        self._jitter = generator(settings.seed, Stream.JITTER)
        self._slip = generator(settings.seed, Stream.SLIP)
        self._measurement = Measurement(settings.seed)

    def reconfigure(self, settings: PlantSettings) -> None:
        """Go on under other settings.

        What was commanded before keeps its wheel speeds, its slip and the time of its effect, and
        of its end if it has taken effect. Initial pose and seed count from the next reset on.

        Args:
            settings: What the robot depends on from the time reached on.
        """
        self._from_pose, self._from_ns, speeds = self.pose, self._now_ns, self._speeds_now()
        self._settings = settings
        self._follow(speeds, self._lagged.target)

    def command(self, stamp_ns: int, linear: float, angular: float) -> None:
        """Ask for a twist; it is driven from ``stamp_ns`` plus the actuation delay on.

        It takes effect in `advance`, also when there is no delay. However the delay may vary, no
        command overtakes another.

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
        effect_ns = stamp_ns + self._delay_ns()
        if self._pending:
            effect_ns = max(effect_ns, self._pending[-1].effect_ns)
        self._pending.append(_Command(effect_ns, self._limited(wheel_speeds), self._next_grip()))

    def advance(self, stamp_ns: int) -> list[Motion]:
        """Let time pass.

        A command counts as in time when its successor takes effect at the very instant at which it
        expires; for that reason the robot stops only once time has gone past that instant.

        Args:
            stamp_ns: Time to reach [ns], not before the time reached.

        Returns:
            The motion at each change of wheel speeds on the way (a command takes effect, or
            expires, or the wheels come nearer to what they lag behind), in order: with them the
            whole path can be drawn again, arc by arc.

        Raises:
            ValueError: ``stamp_ns`` lies in the past.
        """
        if stamp_ns < self._now_ns:
            raise ValueError(f'advance to {stamp_ns} ns: expected {self._now_ns} ns or later')
        changes: list[Motion] = []
        while True:
            effect_ns = self._pending[0].effect_ns if self._pending else math.inf
            expires_ns = math.inf if self._expires_ns is None else self._expires_ns
            self._lag_behind(min(stamp_ns, effect_ns, expires_ns), changes)
            if effect_ns <= min(stamp_ns, expires_ns):
                command = self._pending.popleft()
                self._change(command.effect_ns, command.wheel_speeds)
                self._grip = command.grip
                self._expires_ns = self._expiry(command.effect_ns)
            elif self._expires_ns is not None and self._expires_ns < stamp_ns:
                self._change(self._expires_ns, np.zeros(2))
                self._expires_ns = None
            else:
                break
            changes.append(self.motion)
        self._now_ns = stamp_ns
        return changes

    def measure(self) -> Array | None:
        """Odometry of this instant; every call is another message.

        Returns:
            The pose measured, shape ``(3,)`` [m, m, rad], or None if the message is lost.
        """
        elapsed = (self._now_ns - self._start_ns) / _NS
        return self._measurement.measure(self._settings.odometry, elapsed, self.pose)

    def _change(self, stamp_ns: int, target: Array) -> None:
        """Begin to follow other wheel speeds at an instant."""
        pose = self._pose_at(stamp_ns)
        self._now_ns = stamp_ns
        speeds = self._speeds_now()
        self._from_pose, self._from_ns = pose, stamp_ns
        self._follow(speeds, target)

    def _follow(self, speeds: Array, target: Array) -> None:
        """Let the wheels go from their speeds to others, from the arc's beginning on."""
        self._lagged = LaggedWheels(speeds, target, self._settings.wheel_lag)
        self._followed_ns, self._slice = self._from_ns, 0
        self._wheel_speeds = self._lagged.means(0, 1)[0]

    def _lag_behind(self, stamp_ns: float, changes: list[Motion]) -> None:
        """Drive all slices that end up to an instant, and note the beginning of each next one."""
        if self._slice == self._lagged.slices:
            return
        passed = int(stamp_ns - self._followed_ns) // SLICE_NS
        last = min(passed, self._lagged.slices)
        if last <= self._slice:
            return
        robot, first = self._settings.robot, self._slice
        stamps = [self._followed_ns + k * SLICE_NS for k in range(first + 1, last + 1)]
        speeds = self._lagged.means(first, last + 1)
        durations = np.full(last - first, SLICE_NS / _NS)
        durations[0] = (stamps[0] - self._from_ns) / _NS
        ground = speeds * self._grip
        poses, twists = robot.roll_out(self._from_pose, ground[:-1], durations), robot.twist(ground)
        changes += map(Motion, stamps, poses[1:], speeds[1:], twists[1:])
        self._slice, self._wheel_speeds = last, speeds[-1]
        self._from_pose, self._from_ns = poses[-1].copy(), stamps[-1]
        self._now_ns = stamps[-1]

    def _speeds_now(self) -> Array:
        return self._lagged.at((self._now_ns - self._followed_ns) / _NS)

    def _pose_at(self, stamp_ns: int) -> Array:
        duration = (stamp_ns - self._from_ns) / _NS
        path = self._settings.robot.roll_out(
            self._from_pose, (self._wheel_speeds * self._grip)[None], np.array([duration])
        )
        pose: Array = path[1]
        return pose

    def _delay_ns(self) -> int:
        delay, jitter = self._settings.actuation_delay, self._settings.actuation_jitter
        return round((delay + jitter * self._jitter.random() if jitter else delay) * _NS)

    def _next_grip(self) -> Array:
        grip: Array = 1.0 - np.array(self._settings.wheel_slip, dtype=float)
        stddev = self._settings.wheel_slip_stddev
        # A wheel may lose its grip altogether, but it does not push the robot the other way.
        return np.maximum(grip - stddev * self._slip.standard_normal(2), 0.0) if stddev else grip

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
