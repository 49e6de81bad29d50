"""A robot without mass: exact arcs of constant wheel speeds, in closed form.

Every pose is computed from the beginning of its arc, not from the last call: how finely time is
advanced makes no difference, not even in the last bit.
"""

from __future__ import annotations

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import Robot
from cmpsp_ros.simulator.body import Motion
from cmpsp_ros.simulator.wheel_lag import SLICE_NS, LaggedWheels

_NS = 1_000_000_000


class ArcBody:
    """Wheels that follow a command with a lag, and move the robot less than they turn."""

    def __init__(self, robot: Robot, wheel_lag: float) -> None:
        """A robot that has not been placed yet.

        Args:
            robot: Its kinematics.
            wheel_lag: Time constant with which the wheels follow a command; 0 for none [s].
        """
        self._robot, self._wheel_lag = robot, wheel_lag
        self._slice = 0

    def place(self, stamp_ns: int, pose: Array) -> None:
        """Put the robot at a pose, at rest."""
        self._from_pose, self._from_ns = pose, stamp_ns
        self._grip = np.ones(2)
        self._turn(self._robot.at_rest, self._robot.at_rest)

    def reconfigure(self, stamp_ns: int, robot: Robot, wheel_lag: float) -> None:
        """Go on as another robot: wheels keep their speeds and what was commanded."""
        self._begin_arc(stamp_ns)
        controls = self._controls(stamp_ns)
        self._robot, self._wheel_lag = robot, wheel_lag
        self._turn(controls, self._lagged.target)

    def follow(self, stamp_ns: int, control: Array, grip: Array) -> None:
        """Begin to follow another control at an instant."""
        self._begin_arc(stamp_ns)
        controls, self._grip = self._controls(stamp_ns), grip
        self._turn(controls, control)

    def drive(self, stamp_ns: int) -> list[Motion]:
        """Drive all slices that end up to an instant, and note the beginning of each next one."""
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
        """Pose and speeds on the arc under way."""
        twist = self._robot.twist(self._robot.with_slip(self._control, self._grip))
        speeds = self._robot.speeds_of(self._control.copy())
        return Motion(stamp_ns, self._pose(stamp_ns), speeds, twist)

    def odometry(self, stamp_ns: int) -> Array:
        """The true pose."""
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
        pose: Array = self._robot.roll_out(self._from_pose, ground, np.array([duration]))[1]
        return pose
