"""Models that are defined by their motion alone."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.robots.motion.arcs import with_side
from cmpsp_ros.robots.motion.kinematics import addresses, displacement, steering
from cmpsp_ros.robots.robot import Robot


class DerivedRobot(Robot):
    """A model that is its motion and its steering, for a wheel radius of 1; all else is derived."""

    @staticmethod
    @abstractmethod
    def motion(constants: Any, *controls: Any) -> tuple[Any, Any, Any]:
        """Speed forward and to the left, and turn rate [m/s, m/s, rad/s]; by numpy's functions."""

    @staticmethod
    @abstractmethod
    def steer(constants: Any, forward: float, left: float, turn_rate: float) -> tuple[float, ...]:
        """The controls of a twist, or those that come near to it."""

    def functions(self) -> IntArray:
        """Addresses of the functions compiled from `motion` and `steer`."""
        moves = displacement(self.motion, self.n_controls)
        return addresses(*moves, steering(self.steer, self.n_controls))

    def twist(self, controls: Array) -> Array:
        """Twists ``(..., 2)``, or ``(..., 3)`` of a robot that moves sideways, of controls."""
        twists = self._twists(controls)
        return twists if self.twist_parts > 2 else twists[..., ::2]

    def _twists(self, controls: Array) -> Array:
        found = self.motion(self.constants, *np.moveaxis(controls, -1, 0))
        return self.wheel_radius * np.stack(np.broadcast_arrays(*found), axis=-1)

    def controls(self, twist: Array) -> Array:
        """Controls ``(..., r)`` of twists, of either form."""
        rows = with_side(twist / self.wheel_radius).reshape(-1, 3).tolist()
        found = np.array([self.steer(self.constants, *row) for row in rows], dtype=float)
        return found.reshape(*twist.shape[:-1], self.n_controls)
