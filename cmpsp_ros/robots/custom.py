"""Custom models: their motion and steering as two functions, and their limits."""

from __future__ import annotations

import inspect
import math
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, ClassVar, Final, Self

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.acceleration import TimeScaling
from cmpsp_ros.robots.robot import DerivedRobot, Signal, TwistLimits

_SAMPLES: Final = 21
_ALL: Final = 1.01
"""By which bounds of all twists are larger than those of the samples."""

_STOPPED: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class CustomRobot(DerivedRobot):
    """A robot whose controls, while they are held, give it a twist that depends on them alone.

    Its "wheels" are its controls as parts of their limits, in messages too, and its wheel radius is
    1, or less where they slip. A class derived from it also has `motion` and `steer`.

    Attributes:
        parameters: All parameters by their keys.
    """

    n_controls: ClassVar[int]
    n_speeds: ClassVar[int]

    parameters: Mapping[str, Any]

    @classmethod
    def of(cls, parameters: Mapping[str, Any]) -> Self:
        """The robot that parameters describe, once it is known to be consistent."""
        robot = cls(parameters=parameters, wheel_radius=1.0, max_wheel_speed=1.0)
        if np.min(robot.change_limits) < math.inf:
            robot = replace(robot, max_wheel_acceleration=1.0)
        return robot

    @property
    @abstractmethod
    def limits(self) -> tuple[float, ...]:
        """Largest magnitude of each control."""

    @property
    @abstractmethod
    def change_limits(self) -> tuple[float, ...]:
        """Largest change of each control in a second; infinite for none."""

    @cached_property
    def twist_parts(self) -> int:
        """Three where any control moves it sideways."""
        return 3 if np.any(self._everywhere[:, 1]) else 2

    @property
    def half_track(self) -> float:
        """Smallest radius that it turns with, or else its speed for its turn rate [m]."""
        speed, turn_rate, radius = self._reach
        return speed / turn_rate if self.turns_on_the_spot else radius

    @property
    def max_speed(self) -> float:
        """Largest speed along the path [m/s]."""
        return self._reach[0]

    @property
    def max_acceleration(self) -> float:
        """Largest acceleration along the path [m/s^2]."""
        parts = np.divide(self.change_limits, self.limits)[: self.n_speeds]
        return self.max_speed * float(parts.min())

    @property
    def wheels(self) -> Array:
        """The controls as parts of their limits."""
        return np.diag(1.0 / np.array(self.limits))

    @cached_property
    def rate_limits(self) -> Array:
        """Those that are limited, as parts of their limits."""
        rows = np.diag(1.0 / np.array(self.change_limits))
        limited: Array = rows[np.isfinite(self.change_limits)]
        return limited if len(limited) else self.wheels

    def rates(self, wheel_speeds: Array) -> Array:
        """Controls as parts of their largest change in a second."""
        rates: Array = wheel_speeds * self.bounds @ self.rate_limits.T
        return rates

    @cached_property
    def time_scaling(self) -> TimeScaling:
        """The speeds are scaled; the angles follow as fast as they can."""
        rows = np.diag(1.0 / np.array(self.change_limits))[: self.n_speeds]
        angles = self.change_limits[self.n_speeds :]
        return TimeScaling(rows, self.n_speeds, min(angles, default=math.inf))

    @property
    def bounds(self) -> Array:
        """The limits, shape ``(r,)``."""
        return np.array(self.limits)

    def twist_limits(self) -> TwistLimits:
        """Twists of all controls, and some more."""
        speed, turn_rate, _ = self._reach
        return TwistLimits(_ALL * speed, _ALL * turn_rate)

    def signals(self, twists: Array) -> list[Signal]:
        """Each control, by its name in the signature of `motion`."""
        names = [each.replace('_', ' ') for each in inspect.signature(self.motion).parameters][1:]
        if len(names) != self.n_controls:
            names = [f'control {k + 1}' for k in range(self.n_controls)]
        rows = zip(names, self.controls(twists).T, self.limits, strict=True)
        return [Signal(name, name, values, limit) for name, values, limit in rows]

    def wheel_differences(self, twists: Array, others: Array) -> Array:
        """Differences of the controls as parts of their limits; of angles by how fast it drives."""
        parts = np.array([self.wheel_speeds(twists), self.wheel_speeds(others)])
        off = np.abs(parts[0] - parts[1])
        driving = np.abs(parts[..., : self.n_speeds]).max(axis=(0, 2))
        off[:, self.n_speeds :] *= driving[:, None]
        largest: Array = off.max(axis=1)
        return largest

    def speeds_of(self, controls: Array) -> Array:
        """Controls as parts of their limits, ``(..., r)``."""
        parts: Array = controls / self.bounds
        return parts

    def twist_of_wheels(self, wheel_speeds: Array) -> Array:
        """Twists of controls as parts of their limits."""
        return self.twist(wheel_speeds * self.bounds)

    @cached_property
    def _everywhere(self) -> Array:
        """Twists ``(K, 3)`` of controls all over their range."""
        grids = (np.linspace(-each, each, _SAMPLES) for each in self.limits)
        return self._twists(np.array(list(product(*grids))))

    @cached_property
    def _reach(self) -> tuple[float, float, float]:
        """Largest speed and turn rate, and smallest radius, of controls all over their range."""
        twists = self._everywhere
        speeds, turns = np.hypot(twists[:, 0], twists[:, 1]), np.abs(twists[:, 2])
        moving = speeds > _STOPPED
        tightest = float((turns[moving] / speeds[moving]).max())
        return float(speeds.max()), float(turns.max()), 1.0 / tightest if tightest else math.inf
