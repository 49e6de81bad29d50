"""Robots that steer like cars."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.acceleration import TimeScaling
from cmpsp_ros.robots.robot import Robot, Signal, TwistLimits


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

    n_speeds: ClassVar[int] = 1
    turns_on_the_spot: ClassVar[bool] = False

    wheel_base: float
    max_steering_angle: float
    max_steering_rate: float = math.inf

    @property
    def constants(self) -> tuple[float, ...]:
        """The wheel base."""
        return (self.wheel_base,)

    @staticmethod
    def motion(constants: Any, speed: Any, angle: Any) -> tuple[Any, Any, Any]:
        """Twist of the rear axle."""
        return speed, 0.0, speed * np.tan(angle) / constants[0]

    @staticmethod
    def steer(constants: Any, forward: float, _left: float, turn_rate: float) -> tuple[float, ...]:
        """Speed and angle; at rest straight ahead."""
        return forward, math.atan(constants[0] * turn_rate / forward) if forward != 0.0 else 0.0

    @property
    def half_track(self) -> float:
        """Smallest radius that the robot turns with [m]."""
        return self.wheel_base / math.tan(self.max_steering_angle)

    @property
    def wheels(self) -> Array:
        """The speed, of a control."""
        return np.array([[1.0, 0.0]])

    @property
    def time_scaling(self) -> TimeScaling:
        """The speed is scaled; the steering follows as fast as it can."""
        return TimeScaling(self.wheels, 1, self.max_steering_rate / self.max_wheel_acceleration)

    @property
    def rate_limits(self) -> Array:
        """Steering that changes at its limit counts as much as wheels that do."""
        if self.max_steering_rate == math.inf:
            return self.wheels
        return np.diag([1.0, self.max_wheel_acceleration / self.max_steering_rate])

    @property
    def bounds(self) -> Array:
        """Bounds of wheel speed and steering angle, shape ``(2,)`` [rad/s, rad]."""
        return np.array([self.max_wheel_speed, self.max_steering_angle])

    @property
    def steering_limits(self) -> tuple[float, float]:
        """Limits of steering angle and rate [rad, rad/s]."""
        return self.max_steering_angle, self.max_steering_rate

    def speeds_of(self, controls: Array) -> Array:
        """Speed of the rear wheels, ``(..., 1)`` [rad/s]."""
        speeds: Array = controls[..., :1]
        return speeds

    def twist_limits(self) -> TwistLimits:
        """Twists that the limits of speed and steering allow."""
        return TwistLimits(self.max_speed, self.max_speed / self.half_track)

    def signals(self, twists: Array) -> list[Signal]:
        """Speed and steering angle; a twist at rest leaves the steering as it was."""
        moving = np.where(twists[:, 0] != 0.0, np.arange(len(twists)), 0)
        angles = self.controls(twists)[np.maximum.accumulate(moving), 1]
        return [
            Signal('speed', 'speed [m/s]', twists[:, 0], self.max_speed),
            Signal('steering angle', 'steering angle [rad]', angles, self.max_steering_angle),
        ]

    def over_limit(self, controls: Array) -> str:
        """A sentence about the steering angle."""
        largest = float(np.abs(controls[:, 1]).max())
        if largest <= self.max_steering_angle:
            return ''
        limit = self.max_steering_angle
        return f'The plan has a steering angle of {largest!r} rad, the limit is {limit!r} rad.'

    def steering_of(self, control: Array) -> float:
        """Steering angle of a control [rad]."""
        return float(control[1])
