"""Robots that steer like cars."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.acceleration import Paced
from cmpsp_ros.robots.kinematics import ACKERMANN, Kinematics
from cmpsp_ros.robots.robot import Robot, Signal
from cmpsp_ros.robots.twist_limits import TwistLimits

_REAR: Final = np.array([[1.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class Ackermann(Robot):
    """A car: its pose is that of the middle of the rear axle.

    Controls are the speed of the rear wheels [rad/s] and the steering angle [rad], as of one front
    wheel in the middle.

    Attributes:
        wheel_base: Distance of the axles [m].
        max_steering_angle: Limit in both directions, below a right angle [rad].
        max_steering_rate: Limit of its change; infinite for none, and without a limit of the
            wheels' acceleration [rad/s].
    """

    n_controls: ClassVar[int] = 2
    turns_on_the_spot: ClassVar[bool] = False

    wheel_base: float
    max_steering_angle: float
    max_steering_rate: float = math.inf

    @property
    def half_track(self) -> float:
        """Smallest radius that the robot turns with [m]."""
        return self.wheel_base / math.tan(self.max_steering_angle)

    @cached_property
    def kinematics(self) -> Kinematics:
        """The robot for compiled code."""
        return Kinematics(
            ACKERMANN,
            float(self.wheel_radius),
            float(self.wheel_base),
            _REAR,
            float(self.max_wheel_speed),
            float(self.max_speed),
            float(self.max_steering_angle),
        )

    @cached_property
    def paced(self) -> Paced:
        """The speed is scaled; the steering follows as fast as it can."""
        return Paced(self.wheels, 1, self.max_steering_rate / self.max_wheel_acceleration)

    @cached_property
    def changes(self) -> Array:
        """Steering that changes at its limit counts as much as wheels that do."""
        if self.max_steering_rate == math.inf:
            return _REAR
        return np.diag([1.0, self.max_wheel_acceleration / self.max_steering_rate])

    @property
    def bounds(self) -> Array:
        """Of wheel speed and steering angle, shape ``(2,)`` [rad/s, rad]."""
        return np.array([self.max_wheel_speed, self.max_steering_angle])

    @property
    def steering_limits(self) -> tuple[float, float]:
        """Limits of steering angle and rate [rad, rad/s]."""
        return self.max_steering_angle, self.max_steering_rate

    def slipping(self, slip: float) -> Ackermann:
        """The same robot with wheels that move it by a fraction ``1 - slip`` of their turning."""
        return replace(self, wheel_radius=(1.0 - slip) * self.wheel_radius) if slip else self

    def twist_limits(self) -> TwistLimits:
        """Twists that the limits of speed and steering allow.

        Raises:
            ValueError: There is no limit of the speed.
        """
        return TwistLimits(self.max_speed, self.max_speed / self.half_track)

    def stopped(self, control: Array) -> Array:
        """At rest, with the wheels steered as before."""
        return np.array([0.0, control[1]])

    def twist(self, controls: Array) -> Array:
        """Twists ``(..., 2)`` [m/s, rad/s] of controls."""
        speed = controls[..., 0] * self.wheel_radius
        return np.stack([speed, speed * np.tan(controls[..., 1]) / self.wheel_base], axis=-1)

    def controls(self, twist: Array) -> Array:
        """Controls of twists; at rest it steers straight ahead."""
        speed, turn_rate = twist[..., 0], twist[..., -1]
        moves = speed != 0.0
        bend = np.where(moves, turn_rate / np.where(moves, speed, 1.0), 0.0)
        steering = np.arctan(bend * self.wheel_base)
        return np.stack([speed / self.wheel_radius, steering], axis=-1)

    def wheel_speeds(self, twist: Array) -> Array:
        """Speed of the rear wheels, ``(..., 1)`` [rad/s]."""
        speeds: Array = twist[..., :1] / self.wheel_radius
        return speeds

    def signals(self, twists: Array) -> list[Signal]:
        """Speed and steering angle; a twist at rest leaves the steering as it was."""
        moving = np.where(twists[:, 0] != 0.0, np.arange(len(twists)), 0)
        angles = self.controls(twists)[np.maximum.accumulate(moving), 1]
        return [
            Signal('speed', 'speed [m/s]', twists[:, 0], self.max_speed),
            Signal('steering angle', 'steering angle [rad]', angles, self.max_steering_angle),
        ]

    def twist_of_wheels(self, wheel_speeds: Array) -> Array:
        """Twists of speeds of the rear wheels with steering angles behind them."""
        return self.twist(wheel_speeds)

    def slowed(self, controls: Array, fraction: float) -> Array:
        """Controls with a fraction of the speed, steered as before."""
        slowed: Array = controls * np.array([fraction, 1.0])
        return slowed

    def over_limit(self, controls: Array) -> str:
        """Whether the steering angle is."""
        largest = float(np.abs(controls[:, 1]).max())
        if largest <= self.max_steering_angle:
            return ''
        limit = self.max_steering_angle
        return f'The plan has a steering angle of {largest!r} rad, the limit is {limit!r} rad.'

    def gripping(self, controls: Array, grip: Array) -> Array:
        """The rear wheels move the robot by their part on average."""
        moving: Array = controls * np.array([float(np.mean(grip)), 1.0])
        return moving

    def speeds_of(self, controls: Array) -> Array:
        """Speed of the rear wheels, ``(..., 1)`` [rad/s]."""
        speeds: Array = controls[..., :1]
        return speeds

    def steering_of(self, control: Array) -> float:
        """Steering angle of a control [rad]."""
        return float(control[1])

    def limited(self, controls: Array) -> Array:
        """A control within the limits of speed and steering."""
        limited: Array = np.clip(controls, -self.bounds, self.bounds)
        return limited
