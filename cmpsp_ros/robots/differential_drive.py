"""The two-wheeled robot of the paper (91)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import inner
from cmpsp_ros.robots.motion.kinematics import addresses
from cmpsp_ros.robots.robot import Robot, TwistLimits


@dataclass(frozen=True, kw_only=True)
class DifferentialDrive(Robot):
    """A robot on two driven wheels, steered by their difference in speed: ``U = [w_r, w_l]``.

    `half_track` is the distance from a wheel to the robot's centre, the paper's ``L`` [m].
    """

    half_track: float = 0.055

    @property
    def constants(self) -> tuple[float, ...]:
        """The half track."""
        return (self.half_track,)

    def functions(self) -> IntArray:
        """Addresses of the functions below."""
        return addresses(_displace, _differentiate, _steer)

    @cached_property
    def wheels(self) -> Array:
        """The controls."""
        return np.eye(2)

    def twist_limits(self) -> TwistLimits:
        """Twists that the wheel-speed limit allows."""
        return TwistLimits(self.max_speed, self.max_speed / self.half_track, self.half_track)

    def twist(self, controls: Array) -> Array:
        """Body twists ``(..., 2)`` [m/s, rad/s] of wheel speeds ``(..., 2)`` [rad/s], by (91)."""
        half, across = self.wheel_radius / 2.0, self.wheel_radius / (2.0 * self.half_track)
        if controls.ndim == 1:
            # The same operations on numbers take a fraction of the time.
            right, left = controls.tolist()
            return np.array([(right + left) * half, (right - left) * across])
        twist = np.empty(controls.shape)
        twist[..., 0] = (controls[..., 0] + controls[..., 1]) * half
        twist[..., 1] = (controls[..., 0] - controls[..., 1]) * across
        return twist

    def controls(self, twist: Array) -> Array:
        """Wheel speeds ``(..., 2)`` [rad/s] of body twists; a speed to the side is left out."""
        speed, rim = twist[..., 0], twist[..., -1] * self.half_track
        return np.stack([speed + rim, speed - rim], axis=-1) / self.wheel_radius

    def speeds_of(self, controls: Array) -> Array:
        """The controls themselves."""
        return controls

    def with_slip(self, controls: Array, grip: Array) -> Array:
        """Each wheel moves the robot by its own part."""
        return controls * grip

    def straight_or_turning(self, length: float, turn: float, time: float) -> Array:
        """Wheel speeds; see `Robot.straight_or_turning`."""
        rim = turn * self.half_track
        return np.asarray(np.array([length + rim, length - rim]) / time / self.wheel_radius)


# Written out, not derived from a twist: in this order of operations recorded drives replay bit for
# bit.
@inner
def _displace(values: Array, out: Array, right: float, left: float, _w: float, time: float) -> None:
    out[0, 0] = (right + left) * values[0] / 2.0 * time
    out[0, 1] = 0.0
    out[0, 2] = (right - left) * values[0] / (2.0 * values[1]) * time


@inner
def _differentiate(
    values: Array, out: Array, right: float, left: float, _w: float, time: float
) -> None:
    length, turn = values[0] / 2.0 * time, values[0] / (2.0 * values[1]) * time
    out[0, 0], out[0, 1], out[0, 2] = (right + left) * length, 0.0, (right - left) * turn
    out[1, 0], out[1, 1] = length, length
    out[2, 0], out[2, 1] = 0.0, 0.0
    out[3, 0], out[3, 1] = turn, -turn


@inner
def _steer(
    values: Array, out: Array, forward: float, _left: float, turn_rate: float, _curvature: float
) -> None:
    rim = turn_rate * values[1]
    out[0, 0], out[0, 1] = (forward + rim) / values[0], (forward - rim) / values[0]
