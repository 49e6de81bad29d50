"""What a model of a robot gives to all the rest."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Self

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import robot_functions
from cmpsp_ros.robots.acceleration import Paced
from cmpsp_ros.robots.kinematics import Kinematics
from cmpsp_ros.robots.twist_limits import TwistLimits


class Signal(NamedTuple):
    """A wheel speed or another control over time, as pictures show it.

    Attributes:
        name: Its name, as in `right wheel`.
        axis: Quantity with its unit, as in `wheel speed [rad/s]`.
        values: Shape ``(N,)``.
        limit: Limit of its magnitude; infinite for none.
    """

    name: str
    axis: str
    values: Array
    limit: float

    @property
    def unit(self) -> str:
        """Unit of the quantity; empty where none is known."""
        return self.axis.partition(' [')[2].rstrip(']')


@dataclass(frozen=True, kw_only=True)
class Robot(ABC):
    """A robot on wheels that drives an arc of a circle under a control that is held.

    Twists are ``(speed, turn rate)`` [m/s, rad/s]; of a robot whose reference point also moves
    sideways ``(forward, to the left, turn rate)`` [m/s, m/s, rad/s].

    Attributes:
        n_controls: Number of controls, ``r``.
        drives_sideways: Whether it moves in every direction without turning first.
        turns_on_the_spot: Whether it turns without moving.
        wheel_radius: Of every wheel, the paper's ``r`` [m].
        max_wheel_speed: Limit (94) of every wheel [rad/s]; infinite when there is none.
        max_wheel_acceleration: Limit of every wheel [rad/s^2]; infinite when there is none.
    """

    n_controls: ClassVar[int]
    drives_sideways: ClassVar[bool] = False
    turns_on_the_spot: ClassVar[bool] = True

    wheel_radius: float = 0.035
    max_wheel_speed: float = math.inf
    max_wheel_acceleration: float = math.inf

    @property
    def twist_parts(self) -> int:
        """Two or three."""
        return 3 if self.drives_sideways else 2

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """What pictures call the wheels."""
        return 'right', 'left'

    @property
    @abstractmethod
    def half_track(self) -> float:
        """Speed at the wheels of a unit turn rate [m]."""

    @property
    def max_speed(self) -> float:
        """Largest speed along the path, mostly with all wheels at their limit [m/s]."""
        return self.wheel_radius * self.max_wheel_speed

    @property
    def max_acceleration(self) -> float:
        """Largest acceleration along the path [m/s^2]."""
        return self.wheel_radius * self.max_wheel_acceleration

    @property
    def braking(self) -> float:
        """Deceleration that it is capable of along any arc, in any direction [m/s^2]."""
        return self.max_acceleration

    @property
    @abstractmethod
    def kinematics(self) -> Kinematics:
        """The robot for compiled code."""

    @property
    def wheels(self) -> Array:
        """Wheel speeds of a control, as a matrix ``(W, r)``: limits hold for each of its rows."""
        return self.kinematics.wheels

    @property
    def paced(self) -> Paced:
        """How its controls are slowed down."""
        return Paced(self.wheels, self.n_controls)

    @property
    def changes(self) -> Array:
        """What the limit of acceleration is of, as linear functions of the control ``(q, r)``."""
        return self.wheels

    def changing(self, wheel_speeds: Array) -> Array:
        """What the limit of acceleration is of, of wheel speeds ``(..., W)``."""
        return wheel_speeds

    @property
    def limit_rows(self) -> int:
        """How many constraints of a stage limit the wheel speeds, beyond bounds of the controls."""
        return 0

    @property
    def bounds(self) -> Array:
        """Upper bounds of the controls, shape ``(r,)``; the lower ones are their negatives."""
        return np.full(self.n_controls, self.max_wheel_speed)

    @property
    def steering_limits(self) -> tuple[float, float] | None:
        """Limits of steering angle and rate [rad, rad/s]; None for a robot that is not steered."""
        return None

    @property
    def at_rest(self) -> Array:
        """The control of a robot at rest, shape ``(r,)``."""
        return np.zeros(self.n_controls)

    @abstractmethod
    def slipping(self, slip: float) -> Self:
        """The same robot with wheels that move it by a fraction ``1 - slip`` of their turning."""

    @abstractmethod
    def twist_limits(self) -> TwistLimits:
        """Twists that the wheel-speed limit allows.

        Raises:
            ValueError: There is no wheel-speed limit.
        """

    @abstractmethod
    def twist(self, controls: Array) -> Array:
        """Twists ``(..., 2)`` or ``(..., 3)`` of controls ``(..., r)``."""

    @abstractmethod
    def controls(self, twist: Array) -> Array:
        """Controls ``(..., r)`` of twists, of either form."""

    def wheel_differences(self, twists: Array, others: Array) -> Array:
        """By how much a wheel is faster or slower under some twists than others, ``(N,)``."""
        largest: Array = np.abs(self.wheel_speeds(twists) - self.wheel_speeds(others)).max(axis=1)
        return largest

    @abstractmethod
    def wheel_speeds(self, twist: Array) -> Array:
        """Wheel speeds ``(..., W)`` [rad/s] of twists, of either form."""

    def signals(self, twists: Array) -> list[Signal]:
        """The speed of each wheel under twists ``(N, 2)`` or ``(N, 3)``."""
        speeds = zip(self.wheel_names, self.wheel_speeds(twists).T, strict=True)
        return [
            Signal(f'{name} wheel', 'wheel speed [rad/s]', values, self.max_wheel_speed)
            for name, values in speeds
        ]

    @abstractmethod
    def twist_of_wheels(self, wheel_speeds: Array) -> Array:
        """Twists of wheel speeds ``(..., W)`` [rad/s]."""

    @abstractmethod
    def gripping(self, controls: Array, grip: Array) -> Array:
        """Controls that move a robot without slip as these move it.

        Args:
            controls: Shape ``(..., r)``.
            grip: Part of its turning by which a wheel moves the robot, right and left.
        """

    def straight_or_turning(self, length: float, turn: float, time: float) -> Array:
        """Control, shape ``(r,)``, that drives straight, or turns on the spot, in some time.

        Args:
            length: How far ahead, or 0 [m].
            turn: By how much, or 0 [rad].
            time: How long it takes [s].
        """
        return self.controls(np.array([length, turn]) / time)

    def speeds_of(self, controls: Array) -> Array:
        """Wheel speeds ``(..., W)`` [rad/s] of controls ``(..., r)``."""
        return self.wheel_speeds(self.twist(controls))

    def steering_of(self, control: Array) -> float | None:  # noqa: ARG002
        """Steering angle of a control, shape ``(r,)``; None for a robot that has none [rad]."""
        return None

    def slowed(self, controls: Array, fraction: float) -> Array:
        """Controls ``(..., r)`` that drive the same arcs at a fraction of the speed."""
        return fraction * controls

    def stopped(self, _control: Array) -> Array:
        """The control, shape ``(r,)``, of a robot that comes to rest after another one."""
        return self.at_rest

    def over_limit(self, _controls: Array) -> str:
        """What of some controls, beside the speed of wheels, is beyond its limit, in a sentence.

        Args:
            controls: Shape ``(N, r)``.

        Returns:
            Empty where nothing is.
        """
        return ''

    def limited(self, controls: Array) -> Array:
        """A control, shape ``(r,)``, slowed down along its arc to what the wheels can do."""
        fastest = float(np.abs(self.speeds_of(controls)).max())
        if fastest <= self.max_wheel_speed:
            return controls
        # Divided first: the fastest wheel of a differential drive then has exactly the limit, and
        # rounding cannot lift the other above it.
        slowed: Array = controls / fastest * self.max_wheel_speed
        return slowed

    def all_limited(self, controls: Array, spare: float) -> Array:
        """Controls, shape ``(N, r)``, each slowed down along its arc to what the wheels can do.

        Args:
            controls: The controls.
            spare: What is kept from the limit [rad/s].
        """
        fastest = np.abs(self.speeds_of(controls)).max(axis=1)
        limit = self.max_wheel_speed - spare
        slowed: Array = controls * np.minimum(1.0, limit / np.maximum(fastest, limit))[:, None]
        return slowed

    def roll_out(self, pose: Array, controls: Array, durations: Array) -> Array:
        """Poses along the path driven, exactly, each control held for its duration.

        Args:
            pose: First pose, shape ``(3,)`` [m, m, rad].
            controls: Shape ``(N, r)``.
            durations: Shape ``(N,)`` [s].

        Returns:
            Poses ``(N + 1, 3)`` [m, m, rad]; the heading is not wrapped.
        """
        poses = np.empty((len(durations) + 1, 3))
        poses[0] = pose
        robot_functions.roll_out(poses, controls, durations, self.kinematics)
        return poses

    def jacobians(self, poses: Array, controls: Array, durations: Array) -> tuple[Array, Array]:
        """Derivatives of every step of `roll_out` by its pose and by its control.

        Args:
            poses: Shape ``(N + 1, 3)``, as returned by `roll_out`.
            controls: Shape ``(N, r)``.
            durations: Shape ``(N,)`` [s].

        Returns:
            ``A (N, 3, 3)`` and ``B (N, 3, r)``: the transposes of the paper's ``dF_k/dX_k`` and
            ``dF_k/dU_k``, which it writes with the derivative along rows.
        """
        A = np.zeros((len(durations), 3, 3))
        B = np.zeros((len(durations), 3, self.n_controls))
        robot_functions.put_jacobians(A, B, poses, controls, durations, self.kinematics)
        return A, B
