"""The two-wheeled robot of the paper (91)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.kinematics import DIFFERENTIAL_DRIVE, Kinematics
from cmpsp_ros.robots.robot import Robot
from cmpsp_ros.robots.twist_limits import TwistLimits

RIGHT, LEFT = 0, 1
"""Places of the two wheels in a control vector ``U = [w_r, w_l]``."""

_WHEELS: Final = np.eye(2)


@dataclass(frozen=True, kw_only=True)
class DifferentialDrive(Robot):
    """A robot on two driven wheels, steered by their difference in speed.

    Attributes:
        half_track: Distance from a wheel to the robot's centre, the paper's ``L`` [m].
    """

    n_controls: ClassVar[int] = 2

    half_track: float = 0.055

    @cached_property
    def kinematics(self) -> Kinematics:
        """The robot for compiled code."""
        return Kinematics(
            DIFFERENTIAL_DRIVE,
            float(self.wheel_radius),
            float(self.half_track),
            _WHEELS,
            float(self.max_wheel_speed),
            float(self.max_speed),
        )

    def slipping(self, slip: float) -> DifferentialDrive:
        """The same robot with wheels that move it by a fraction ``1 - slip`` of their turning."""
        return replace(self, wheel_radius=(1.0 - slip) * self.wheel_radius) if slip else self

    def twist_limits(self) -> TwistLimits:
        """Twists that the wheel-speed limit allows.

        Raises:
            ValueError: There is no wheel-speed limit.
        """
        return TwistLimits(self.max_speed, self.max_speed / self.half_track, self.half_track)

    def twist(self, controls: Array) -> Array:
        """Body twists ``(..., 2)`` [m/s, rad/s] of wheel speeds ``(..., 2)`` [rad/s], by (91)."""
        if controls.ndim == 1:
            # The same operations on numbers take a fraction of the time.
            right, left = controls.tolist()
            speed = (right + left) * (self.wheel_radius / 2.0)
            return np.array([speed, (right - left) * (self.wheel_radius / (2.0 * self.half_track))])
        right, left = controls[..., RIGHT], controls[..., LEFT]
        twist = np.empty_like(controls, dtype=float)
        twist[..., 0] = (right + left) * (self.wheel_radius / 2.0)
        twist[..., 1] = (right - left) * (self.wheel_radius / (2.0 * self.half_track))
        return twist

    def controls(self, twist: Array) -> Array:
        """Wheel speeds, which are the controls; see `wheel_speeds`."""
        return self.wheel_speeds(twist)

    def wheel_speeds(self, twist: Array) -> Array:
        """Wheel speeds ``(..., 2)`` [rad/s] of body twists; a speed to the side is left out."""
        speed, rim = twist[..., 0], twist[..., -1] * self.half_track
        return np.stack([speed + rim, speed - rim], axis=-1) / self.wheel_radius

    def twist_of_wheels(self, wheel_speeds: Array) -> Array:
        """Body twists of wheel speeds; see `twist`."""
        return self.twist(wheel_speeds)

    def gripping(self, controls: Array, grip: Array) -> Array:
        """Each wheel moves the robot by its own part."""
        return controls * grip

    def straight_or_turning(self, length: float, turn: float, time: float) -> Array:
        """Wheel speeds; see `Robot.straight_or_turning`."""
        rim = turn * self.half_track
        speeds: Array = np.array([length + rim, length - rim]) / time / self.wheel_radius
        return speeds

    def speeds_of(self, controls: Array) -> Array:
        """The controls themselves."""
        return controls
