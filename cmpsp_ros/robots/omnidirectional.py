"""Robots that drive in every direction: on mecanum wheels, or on three or more omni wheels."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any, ClassVar, Final, Self

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.motion.arcs import with_side
from cmpsp_ros.robots.robot import DerivedRobot, TwistLimits

Rim = tuple[float, float, float]

_SINGULAR: Final = 1e-9  # below it three wheels leave a direction free, and a robot goes straight
_MECANUM: Final = 'front left', 'front right', 'rear right', 'rear left'
_ALL: Final = 1.0 + 1e-9  # by which a bound is larger than rounding can make what it bounds


@dataclass(frozen=True, kw_only=True)
class Omnidirectional(DerivedRobot):
    """A robot whose controls are the speeds of the three wheels that depend on each other least.

    Limits of all others are constraints. `rims` are for each wheel the speed of its rim for a unit
    of forward speed, of speed to the left, and of turn rate, the last one in metres.
    """

    n_controls: ClassVar[int] = 3
    n_speeds: ClassVar[int] = 3
    drives_sideways: ClassVar[bool] = True

    rims: tuple[Rim, ...]

    @classmethod
    def mecanum(cls, half_track: float, half_wheel_base: float, **of_wheels: float) -> Self:
        """A robot on four mecanum wheels, rollers at 45 degrees, as `mecanum_drive_controller`.

        Wheels are front left, front right, rear right, rear left, with limits of a `Robot`.
        """
        arm = half_track + half_wheel_base
        rims = ((1.0, -1.0, -arm), (1.0, 1.0, arm), (1.0, -1.0, arm), (1.0, 1.0, -arm))
        return cls(rims=rims, **of_wheels)

    @classmethod
    def on_omni_wheels(cls, distance: float, bearings: Iterable[float], **of_wheels: float) -> Self:
        """A robot on omni wheels at a distance from its centre [m], at bearings ahead [rad]."""
        rims = tuple((-math.sin(each), math.cos(each), distance) for each in bearings)
        return cls(rims=rims, **of_wheels)

    @cached_property
    def constants(self) -> tuple[float, ...]:
        """Twist of a control, as a matrix, and its inverse, for a wheel radius of 1."""
        driven = np.array(self.rims)[self.driven]
        return (*np.linalg.inv(driven).ravel().tolist(), *driven.ravel().tolist())

    @staticmethod
    def motion(constants: Any, a: Any, b: Any, c: Any) -> tuple[Any, Any, Any]:
        """Twist of three wheel speeds."""
        return (
            constants[0] * a + constants[1] * b + constants[2] * c,
            constants[3] * a + constants[4] * b + constants[5] * c,
            constants[6] * a + constants[7] * b + constants[8] * c,
        )

    @staticmethod
    def steer(constants: Any, forward: float, left: float, turn_rate: float) -> tuple[float, ...]:
        """Speeds of three wheels."""
        return (
            constants[9] * forward + constants[10] * left + constants[11] * turn_rate,
            constants[12] * forward + constants[13] * left + constants[14] * turn_rate,
            constants[15] * forward + constants[16] * left + constants[17] * turn_rate,
        )

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels in pictures."""
        count = len(self.rims)
        return _MECANUM if self.rims[0][0] else tuple(f'{k + 1}.' for k in range(count))

    @property
    def half_track(self) -> float:
        """Largest speed of a rim for a unit turn rate [m]."""
        return max(abs(turning) for _, _, turning in self.rims)

    @property
    def max_speed(self) -> float:
        """Largest speed of all directions [m/s]."""
        return self.wheel_radius * self.max_wheel_speed * self._reach[0]

    @property
    def max_acceleration(self) -> float:
        """Largest acceleration of all directions [m/s^2]."""
        return self.wheel_radius * self.max_wheel_acceleration * self._reach[0]

    @property
    def braking(self) -> float:
        """Deceleration in the direction in which it is least [m/s^2]."""
        steepest = max(math.hypot(forward, left) for forward, left, _ in self.rims)
        return self.wheel_radius * self.max_wheel_acceleration / steepest

    @cached_property
    def driven(self) -> list[int]:
        """The wheels whose speeds are the controls."""
        rims = np.array(self.rims)
        threes = combinations(range(len(rims)), 3)
        return list(max(threes, key=lambda three: abs(np.linalg.det(rims[list(three)]))))

    @cached_property
    def wheels(self) -> Array:
        """Wheel speeds of a control, as a matrix ``(W, 3)``, those of the controls first."""
        rest = [wheel for wheel in range(len(self.rims)) if wheel not in self.driven]
        return np.concatenate([np.eye(3), self._wheels[rest]])

    @property
    def limit_rows(self) -> int:
        """Two for each wheel that is no control, where there is a limit."""
        return 2 * (len(self.rims) - 3) if self.max_wheel_speed < math.inf else 0

    def twist_limits(self) -> TwistLimits:
        """Twists that the wheel-speed limit allows, and some more."""
        speed, turn_rate, arm = self._reach
        rim = _ALL * self.wheel_radius * self.max_wheel_speed
        return TwistLimits(speed * rim, turn_rate * rim, arm)

    def controls(self, twist: Array) -> Array:
        """Controls ``(..., 3)`` of twists, of either form."""
        return np.asarray(self.wheel_speeds(twist)[..., self.driven])

    def wheel_speeds(self, twist: Array) -> Array:
        """Wheel speeds ``(..., W)`` [rad/s] of twists, of all wheels at once."""
        return np.asarray(with_side(twist) @ self._turning.T)

    def twist_of_wheels(self, wheel_speeds: Array) -> Array:
        """Twists ``(..., 3)`` that fit wheel speeds ``(..., W)`` [rad/s] best."""
        return np.asarray(wheel_speeds @ np.linalg.pinv(self._turning).T)

    def speeds_of(self, controls: Array) -> Array:
        """Wheel speeds ``(..., W)`` [rad/s] of controls ``(..., 3)``."""
        return np.asarray(controls @ self._wheels.T)

    def limited(self, controls: Array) -> Array:
        """A control, slowed down along its arc until no wheel exceeds its limit by a bit."""
        slowed = super().limited(controls)
        while float(np.abs(self.speeds_of(slowed)).max()) > self.max_wheel_speed:
            slowed = slowed * (1.0 - np.finfo(float).eps)
        return slowed

    @cached_property
    def _turning(self) -> Array:
        """Wheel speeds of a twist, as a matrix ``(W, 3)``."""
        return np.asarray(np.array(self.rims) / self.wheel_radius)

    @cached_property
    def _wheels(self) -> Array:
        """Wheel speeds of a control, as a matrix ``(W, 3)``, in the order of the wheels."""
        rims = np.array(self.rims)
        wheels: Array = rims @ np.linalg.inv(rims[self.driven])
        wheels[self.driven] = np.eye(3)
        return wheels

    @cached_property
    def _reach(self) -> tuple[float, float, float]:
        """Largest speed, turn rate and arm of the limits for rims of speed 1: at corners."""
        rims, corners = np.array(self.rims), []
        signs = [np.array(each) for each in product((1.0, -1.0), repeat=3)]
        for three, each in product(combinations(rims, 3), signs):
            if abs(np.linalg.det(three)) > _SINGULAR * self.half_track:
                corner = np.linalg.solve(three, each)
                if np.abs(rims @ corner).max() <= _ALL:
                    corners.append((math.hypot(corner[0], corner[1]), abs(float(corner[2]))))
        speed = max(corner[0] for corner in corners)
        turn_rate = max(corner[1] for corner in corners)
        arms = [(speed - moving) / turning for moving, turning in corners if turning > _SINGULAR]
        return speed, turn_rate, max(min(arms), 0.0)
