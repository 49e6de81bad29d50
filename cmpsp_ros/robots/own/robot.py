"""A model of one's own: its motion and what steers it as two functions, and its limits."""

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
from cmpsp_ros.robots.acceleration import Paced
from cmpsp_ros.robots.arcs import with_side
from cmpsp_ros.robots.kinematics import OWN, OWN_SIDEWAYS, Kinematics
from cmpsp_ros.robots.own.functions import addresses
from cmpsp_ros.robots.robot import Robot, Signal
from cmpsp_ros.robots.twist_limits import TwistLimits

_SAMPLES: Final = 21
_ALL: Final = 1.01
"""By which bounds of all twists are larger than those of the samples."""

_STOPPED: Final = 1e-9


@dataclass(frozen=True, kw_only=True)
class OwnRobot(Robot):
    """A robot whose controls, while they are held, give it a twist that depends on them alone.

    Its "wheels" are its controls as parts of their limits, in messages too.

    Attributes:
        n_speeds: How many of the controls, the first, are 0 at rest; the others are angles.
        parameters: All parameters by their keys.
        grip: Fraction of its twist that slip leaves.
    """

    n_speeds: ClassVar[int]

    parameters: Mapping[str, Any]
    grip: float = 1.0

    @classmethod
    def of(cls, parameters: Mapping[str, Any]) -> Self:
        """The robot that parameters describe, once it is known to be consistent."""
        robot = cls(parameters=parameters, wheel_radius=1.0, max_wheel_speed=1.0)
        if np.min(robot.change_limits) < math.inf:
            robot = replace(robot, max_wheel_acceleration=1.0)
        return robot

    @property
    @abstractmethod
    def constants(self) -> tuple[float, ...]:
        """What `motion` and `steer` are given first."""

    @property
    @abstractmethod
    def limits(self) -> tuple[float, ...]:
        """Largest magnitude of each control."""

    @property
    @abstractmethod
    def change_limits(self) -> tuple[float, ...]:
        """Largest change of each control in a second; infinite for none."""

    @staticmethod
    @abstractmethod
    def motion(constants: Any, *controls: Any) -> tuple[Any, Any, Any]:
        """Speed forward and to the left, and turn rate [m/s, m/s, rad/s]; by numpy's functions."""

    @staticmethod
    @abstractmethod
    def steer(constants: Any, forward: float, left: float, turn_rate: float) -> tuple[float, ...]:
        """The controls of a twist, or those that come near to it."""

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

    @cached_property
    def kinematics(self) -> Kinematics:
        """The robot for compiled code."""
        return Kinematics(
            OWN_SIDEWAYS if self.drives_sideways else OWN,
            float(self.grip),
            0.0 if self.turns_on_the_spot else float(self.half_track),
            self.wheels,
            float(self.max_wheel_speed),
            float(self.max_speed),
            functions=addresses(self.motion, self.steer, self.n_controls),
            values=np.array([self.grip, *self.constants]),
            scratch=np.zeros((4, 3)),
        )

    @property
    def wheels(self) -> Array:
        """The controls as parts of their limits."""
        return np.diag(1.0 / np.array(self.limits))

    @cached_property
    def changes(self) -> Array:
        """Those that are limited, as parts of their limits."""
        rows = np.diag(1.0 / np.array(self.change_limits))
        limited: Array = rows[np.isfinite(self.change_limits)]
        return limited if len(limited) else self.wheels

    def changing(self, wheel_speeds: Array) -> Array:
        """Controls as parts of their largest change in a second."""
        changing: Array = wheel_speeds * self.bounds @ self.changes.T
        return changing

    @cached_property
    def paced(self) -> Paced:
        """The speeds are scaled; the angles follow as fast as they can."""
        rows = np.diag(1.0 / np.array(self.change_limits))[: self.n_speeds]
        angles = self.change_limits[self.n_speeds :]
        return Paced(rows, self.n_speeds, min(angles, default=math.inf))

    @property
    def bounds(self) -> Array:
        """Of the controls, shape ``(r,)``."""
        return np.array(self.limits)

    def slipping(self, slip: float) -> Self:
        """The same robot with wheels that move it by a fraction ``1 - slip`` of their turning."""
        return replace(self, grip=(1.0 - slip) * self.grip) if slip else self

    def twist_limits(self) -> TwistLimits:
        """Twists of all controls, and some more."""
        speed, turn_rate, _ = self._reach
        return TwistLimits(_ALL * speed, _ALL * turn_rate)

    def twist(self, controls: Array) -> Array:
        """Twists ``(..., 2)``, or ``(..., 3)`` of a robot that moves sideways, of controls."""
        twists = self._moved(controls)
        return twists if self.twist_parts > 2 else twists[..., ::2]

    def controls(self, twist: Array) -> Array:
        """Controls ``(..., r)`` of twists, of either form."""
        rows = with_side(twist / self.grip).reshape(-1, 3).tolist()
        found = np.array([self.steer(self.constants, *row) for row in rows], dtype=float)
        return found.reshape(*twist.shape[:-1], self.n_controls)

    def wheel_speeds(self, twist: Array) -> Array:
        """Controls of twists as parts of their limits, ``(..., r)``."""
        return self.speeds_of(self.controls(twist))

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

    def gripping(self, controls: Array, grip: Array) -> Array:
        """The speeds, as far as the wheels grip on average."""
        return self.slowed(controls, float(np.mean(grip)))

    def slowed(self, controls: Array, fraction: float) -> Array:
        """Controls with a fraction of the speeds, and the same angles."""
        slowed = controls.copy()
        slowed[..., : self.n_speeds] *= fraction
        return slowed

    def stopped(self, control: Array) -> Array:
        """At rest, with the same angles."""
        return self.slowed(control, 0.0)

    def limited(self, controls: Array) -> Array:
        """A control within its limits."""
        limited: Array = np.clip(controls, -self.bounds, self.bounds)
        return limited

    def _moved(self, controls: Array) -> Array:
        found = self.motion(self.constants, *np.moveaxis(controls, -1, 0))
        return self.grip * np.stack(np.broadcast_arrays(*found), axis=-1)

    @cached_property
    def _everywhere(self) -> Array:
        """Twists ``(K, 3)`` of controls all over their range."""
        grids = (np.linspace(-each, each, _SAMPLES) for each in self.limits)
        return self._moved(np.array(list(product(*grids))))

    @cached_property
    def _reach(self) -> tuple[float, float, float]:
        """Largest speed and turn rate, and smallest radius, of controls all over their range."""
        twists = self._everywhere
        speeds, turns = np.hypot(twists[:, 0], twists[:, 1]), np.abs(twists[:, 2])
        moving = speeds > _STOPPED
        tightest = float((turns[moving] / speeds[moving]).max())
        return float(speeds.max()), float(turns.max()), 1.0 / tightest if tightest else math.inf
