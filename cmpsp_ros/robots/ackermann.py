"""Robots that steer like cars."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import inner
from cmpsp_ros.robots.motion.acceleration import TimeScaling
from cmpsp_ros.robots.motion.kinematics import addresses
from cmpsp_ros.robots.robot import Robot, Signal, TwistLimits


@dataclass(frozen=True, kw_only=True)
class Ackermann(Robot):
    """A car: its pose is that of the middle of the rear axle.

    Controls are the speed of the rear wheels [rad/s] and the angle of one front wheel [rad]. Its
    rate is limited only where the acceleration is; infinite for none.
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

    def functions(self) -> IntArray:
        """Addresses of the functions below."""
        return addresses(_displace, _differentiate, _steer)

    @property
    def half_track(self) -> float:
        """Smallest radius that the robot turns with [m]."""
        return self.wheel_base / math.tan(self.max_steering_angle)

    @property
    def max_curvature(self) -> float:
        """Curvature at the largest steering angle [1/m]."""
        return math.tan(self.max_steering_angle) / self.wheel_base

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

    def twist(self, controls: Array) -> Array:
        """Twists ``(..., 2)`` [m/s, rad/s] of controls."""
        speed = controls[..., 0] * self.wheel_radius
        return np.stack([speed, speed * np.tan(controls[..., 1]) / self.wheel_base], axis=-1)

    def controls(self, twist: Array) -> Array:
        """Controls of twists; at rest it steers straight ahead."""
        speed, turn_rate = twist[..., 0], twist[..., -1]
        moves = speed != 0.0
        curvature = np.where(moves, turn_rate / np.where(moves, speed, 1.0), 0.0)
        steering = np.arctan(curvature * self.wheel_base)
        return np.stack([speed / self.wheel_radius, steering], axis=-1)

    def speeds_of(self, controls: Array) -> Array:
        """Speed of the rear wheels, ``(..., 1)`` [rad/s]."""
        return np.asarray(controls[..., :1])

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
        """A sentence about the steering angle, or about the lateral acceleration."""
        largest = float(np.abs(controls[:, 1]).max())
        if largest <= self.max_steering_angle:
            return super().over_limit(controls)
        limit = self.max_steering_angle
        return f'The plan has a steering angle of {largest!r} rad, the limit is {limit!r} rad.'

    def steering_of(self, control: Array) -> float:
        """Steering angle of a control [rad]."""
        return float(control[1])


# Written out, not derived from a twist: in this order of operations recorded drives replay bit for
# bit.
@inner
def _displace(
    values: Array, out: Array, speed: float, angle: float, _w: float, time: float
) -> None:
    length = speed * values[0] * time
    out[0, 0], out[0, 1], out[0, 2] = length, 0.0, length * math.tan(angle) / values[1]


@inner
def _differentiate(
    values: Array, out: Array, speed: float, angle: float, _w: float, time: float
) -> None:
    per_speed, wheel_base, bend = values[0] * time, values[1], math.tan(angle) / values[1]
    length = speed * per_speed
    out[0, 0], out[0, 1], out[0, 2] = length, 0.0, length * bend
    out[1, 0], out[1, 1] = per_speed, 0.0
    out[2, 0], out[2, 1] = 0.0, 0.0
    out[3, 0], out[3, 1] = per_speed * bend, length * (1.0 / wheel_base + wheel_base * bend * bend)


@inner
def _steer(
    values: Array, out: Array, forward: float, _left: float, _turn_rate: float, curvature: float
) -> None:
    out[0, 0], out[0, 1] = forward / values[0], math.atan(curvature * values[1])
