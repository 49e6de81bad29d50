"""The mechanics of a plant, and a robot without mass: wheels with a lag, and exact arcs."""

import math
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import Robot


@dataclass(frozen=True)
class Motion:
    """Pose of the robot at an instant [m, m, rad], not wrapped, and its motion from there on.

    The wheels turn at `wheel_speeds` ``(W,)`` [rad/s]; the twist is as of a `Robot`.
    """

    stamp_ns: int
    pose: Array
    wheel_speeds: Array
    twist: Array


SLICE_NS = 5_000_000  # length of a slice [ns]

_SLICE = SLICE_NS / 1_000_000_000

_SETTLED = 1e-9  # distance from the command at which a wheel counts as having reached it [rad/s]


class LaggedWheels:
    """A control ``(r,)`` after one change of the command, reached after so many `slices`."""

    def __init__(self, speeds: Array, target: Array, time_constant: float) -> None:
        """Begin a change from the control in effect to another ``(r,)``; ``T`` is 0 for no lag."""
        self.target = target
        self._gap = speeds - target
        self._rate = 1.0 / time_constant if time_constant > 0.0 else math.inf
        gap = float(np.abs(self._gap).max())
        decades = math.log(gap / _SETTLED) if gap > _SETTLED else 0.0
        # A lag so short that its inverse is infinite is none.
        slices = decades / (_SLICE * self._rate)
        self.slices = math.ceil(slices) if self._rate < math.inf else 0

    def at(self, elapsed: float) -> Array:
        """Control in effect ``(r,)`` some time after the change [s]."""
        if self.slices == 0:
            return self.target
        return np.asarray(self.target + self._gap * math.exp(-elapsed * self._rate))

    def means(self, first: int, end: int) -> Array:
        """Mean controls in some slices, ``(end - first, r)``; they change up to number `slices`."""
        means = np.repeat(self.target[None], end - first, axis=0)
        if self.slices == 0:
            return means
        ratio = _SLICE * self._rate
        share = -math.expm1(-ratio) / ratio
        # One by one: vectors of other lengths may be rounded otherwise.
        left = [math.exp(-k * ratio) * share if k < self.slices else 0.0 for k in range(first, end)]
        means += np.array(left)[:, None] * self._gap
        return means


_NS = 1_000_000_000


class ArcBody:
    """Wheels that follow a command with a lag, and move the robot less than they turn.

    Times are in integer nanoseconds and never go back.
    """

    def __init__(self, robot: Robot, wheel_lag: float) -> None:
        """A robot that has not been placed yet; the lag of its wheels is 0 for none [s]."""
        self._robot, self._wheel_lag = robot, wheel_lag
        self._slice = 0

    def place(self, stamp_ns: int, pose: Array) -> None:
        """Put the robot at a pose, shape ``(3,)`` [m, m, rad], at rest."""
        self._from_pose, self._from_ns = pose, stamp_ns
        self._grip = np.ones(2)
        self._turn(self._robot.at_rest, self._robot.at_rest)

    def reconfigure(self, stamp_ns: int, robot: Robot, wheel_lag: float) -> None:
        """Continue as another robot; wheels keep their speeds and commands."""
        self._begin_arc(stamp_ns)
        controls = self._controls(stamp_ns)
        self._robot, self._wheel_lag = robot, wheel_lag
        self._turn(controls, self._lagged.target)

    def follow(self, stamp_ns: int, control: Array, grip: Array) -> None:
        """Obey a control ``(r,)`` from an instant reached by `drive`, with grip right and left."""
        self._begin_arc(stamp_ns)
        controls, self._grip = self._controls(stamp_ns), grip
        self._turn(controls, control)

    def drive(self, stamp_ns: int) -> list[Motion]:
        """Drive all slices that end up to an instant; the motion at the beginning of each next."""
        passed = (stamp_ns - self._followed_ns) // SLICE_NS
        first, last = self._slice, min(passed, self._lagged.slices)
        if last <= first:
            return []
        stamps = [self._followed_ns + k * SLICE_NS for k in range(first + 1, last + 1)]
        controls = self._lagged.means(first, last + 1)
        durations = np.full(last - first, SLICE_NS / _NS)
        durations[0] = (stamps[0] - self._from_ns) / _NS
        ground = self._robot.with_slip(controls, self._grip)
        poses = self._robot.roll_out(self._from_pose, ground[:-1], durations)
        self._slice, self._control = last, controls[-1]
        self._from_pose, self._from_ns = poses[-1].copy(), stamps[-1]
        speeds, twists = self._robot.speeds_of(controls), self._robot.twist(ground)
        return list(map(Motion, stamps, poses[1:], speeds[1:], twists[1:]))

    def motion(self, stamp_ns: int) -> Motion:
        """Pose and speeds at the instant reached by `drive`, or right after it."""
        twist = self._robot.twist(self._robot.with_slip(self._control, self._grip))
        speeds = self._robot.speeds_of(self._control.copy())
        return Motion(stamp_ns, self._pose(stamp_ns), speeds, twist)

    def odometry(self, stamp_ns: int) -> Array:
        """The pose that a perfect measurement would give, shape ``(3,)`` [m, m, rad]."""
        return self._pose(stamp_ns)

    def _begin_arc(self, stamp_ns: int) -> None:
        self._from_pose, self._from_ns = self._pose(stamp_ns), stamp_ns

    def _turn(self, control: Array, target: Array) -> None:
        """Let the wheels go from one control to another, from the arc's beginning on."""
        self._lagged = LaggedWheels(control, target, self._wheel_lag)
        self._followed_ns, self._slice = self._from_ns, 0
        self._control = self._lagged.means(0, 1)[0]

    def _controls(self, stamp_ns: int) -> Array:
        return self._lagged.at((stamp_ns - self._followed_ns) / _NS)

    def _pose(self, stamp_ns: int) -> Array:
        duration = (stamp_ns - self._from_ns) / _NS
        ground = self._robot.with_slip(self._control, self._grip)[None]
        return np.asarray(self._robot.roll_out(self._from_pose, ground, np.array([duration]))[1])
