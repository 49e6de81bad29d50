"""A stand-in for the robot: velocity commands in, the path driven and its odometry out.

Nothing here reads a clock: time is an argument in integer nanoseconds, so a run repeats exactly. A
command waits for its delay, is followed by the wheels with their lag, and moves the robot less than
they turn where they slip; all off by default.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.simulator.body import ArcBody, Motion
from cmpsp_ros.simulator.measurement import Measurement, Stream, generator
from cmpsp_ros.simulator.physics import PhysicsBody
from cmpsp_ros.simulator.settings import PlantSettings

_NS = 1_000_000_000


class TwistError(ValueError):
    """A commanded twist that no wheel can follow: not finite, or too large."""


class _Command(NamedTuple):
    """A command under way."""

    effect_ns: int
    control: Array
    grip: Array


class Plant:
    """The robot between commands."""

    def __init__(self, settings: PlantSettings, start_ns: int = 0) -> None:
        """Put the robot at its initial pose, at rest, at a time [ns]; or PhysicsError."""
        self._settings = settings
        self._now_ns = self._heard_ns = start_ns
        wheels = settings.robot, settings.wheel_lag
        self._body = (
            ArcBody(*wheels) if settings.physics is None else PhysicsBody(*wheels, settings.physics)
        )
        self.reset()

    @property
    def stamp_ns(self) -> int:
        """Time reached [ns]."""
        return self._now_ns

    @property
    def motion(self) -> Motion:
        """Pose and speeds now: the true ones, after wheel limits, lag and slip."""
        return self._body.motion(self._now_ns)

    @property
    def pose(self) -> Array:
        """True pose, shape ``(3,)`` [m, m, rad]; the heading is not wrapped."""
        return self.motion.pose

    @property
    def wheel_speeds(self) -> Array:
        """Speeds at which the wheels turn, shape ``(W,)`` [rad/s]."""
        return self.motion.wheel_speeds

    @property
    def twist(self) -> Array:
        """Twist driven, as of a `Robot`."""
        return self.motion.twist

    def reset(self) -> None:
        """Put the robot back to its initial pose, at rest; time goes on, commands are forgotten."""
        settings = self._settings
        self._start_ns = self._heard_ns = self._now_ns
        self._body.place(self._now_ns, np.array(settings.initial_pose, dtype=float))
        self._pending: deque[_Command] = deque()
        self._expires_ns: int | None = None
        self._latest = settings.robot.at_rest
        self._grip = 1.0 - np.array(settings.wheel_slip, dtype=float)
        self._jitter = generator(settings.seed, Stream.JITTER)
        self._slip = generator(settings.seed, Stream.SLIP)
        self._measurement = Measurement(settings.seed)

    def reconfigure(self, settings: PlantSettings) -> None:
        """Continue under other settings.

        Earlier commands keep wheel speeds, slip and time of effect, those in effect also their end.
        Initial pose, seed and physics count from the next reset on.
        """
        self._settings = settings
        self._body.reconfigure(self._now_ns, settings.robot, settings.wheel_lag)

    def command(self, stamp_ns: int, *twist: float) -> None:
        """Ask for a twist [m/s, rad/s], driven from ``stamp_ns`` plus the actuation delay on.

        A controller with a period takes it at its next instant. It takes effect in `advance`, also
        when there is no delay. However the delay may vary, no command overtakes another.
        TwistError, and the last one stays in force, if it is not finite; ValueError if ``stamp_ns``
        is before now or the last command.
        """
        earliest_ns = max(self._now_ns, self._heard_ns)
        if stamp_ns < earliest_ns:
            raise ValueError(f'command at {stamp_ns} ns: expected {earliest_ns} ns or later')
        robot, wanted = self._settings.robot, np.array(twist)
        *speeds, angular = twist
        said = f'twist ({", ".join(f"{each} m/s" for each in speeds)}, {angular} rad/s)'
        if not np.isfinite(wanted).all():
            raise TwistError(f'{said}: expected finite numbers')
        with np.errstate(over='ignore', invalid='ignore'):
            is_possible = np.isfinite(robot.wheel_speeds(wanted)).all()
            control = robot.controls(wanted) if wanted.any() else robot.stopped(self._latest)
        if not is_possible:
            raise TwistError(f'{said}: too large for any wheel')
        self._heard_ns, self._latest = stamp_ns, robot.limited(control)
        effect_ns = self._effect_ns(stamp_ns)
        if self._pending:
            effect_ns = max(effect_ns, self._pending[-1].effect_ns)
        self._pending.append(_Command(effect_ns, self._latest, self._next_grip()))

    def advance(self, stamp_ns: int) -> list[Motion]:
        """Let time pass up to an instant [ns]; ValueError for one in the past.

        A command may be followed at the very instant at which it expires: the robot stops later.
        Returns the motion at each change of wheel speeds on the way, in order.
        """
        if stamp_ns < self._now_ns:
            raise ValueError(f'advance to {stamp_ns} ns: expected {self._now_ns} ns or later')
        changes: list[Motion] = []
        while True:
            effect_ns = self._pending[0].effect_ns if self._pending else None
            next_ns = min(
                each for each in (stamp_ns, effect_ns, self._expires_ns) if each is not None
            )
            changes += self._body.drive(next_ns)
            if effect_ns == next_ns:
                command = self._pending.popleft()
                self._grip = command.grip
                self._body.follow(next_ns, command.control, command.grip)
                lasts = self._settings.cmd_vel_timeout
                self._expires_ns = next_ns + round(lasts * _NS) if 0.0 < lasts < math.inf else None
            elif self._expires_ns == next_ns < stamp_ns:
                self._body.follow(next_ns, self._settings.robot.stopped(self._latest), self._grip)
                self._expires_ns = None
            else:
                break
            changes.append(self._body.motion(next_ns))
        self._now_ns = stamp_ns
        return changes

    def measure(self) -> Array | None:
        """Pose measured now, ``(3,)`` [m, m, rad], None if lost; every call is another message."""
        elapsed = (self._now_ns - self._start_ns) / _NS
        pose = self._body.odometry(self._now_ns)
        return self._measurement.measure(self._settings.odometry, elapsed, pose)

    def _effect_ns(self, stamp_ns: int) -> int:
        """When the controller takes a command of an instant, after its delay [ns]."""
        delay, jitter = self._settings.actuation_delay, self._settings.actuation_jitter
        delay += jitter * self._jitter.random() if jitter else 0.0
        arrival_ns = stamp_ns + round(delay * _NS)
        period_ns = round(self._settings.actuation_period * _NS)
        wait_ns = -(arrival_ns - self._start_ns) % period_ns if period_ns else 0
        return arrival_ns + wait_ns

    def _next_grip(self) -> Array:
        grip: Array = 1.0 - np.array(self._settings.wheel_slip, dtype=float)
        stddev = self._settings.wheel_slip_stddev
        # A wheel may lose its grip altogether, but it does not push the robot the other way.
        return np.maximum(grip - stddev * self._slip.standard_normal(2), 0.0) if stddev else grip
