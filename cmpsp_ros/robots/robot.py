"""Models of robots: motion, limits, slowing down."""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Final, NamedTuple, Self

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.robots.motion import kinematics
from cmpsp_ros.robots.motion.acceleration import TimeScaling
from cmpsp_ros.robots.motion.arcs import speeds_and_turns, with_side
from cmpsp_ros.robots.motion.kinematics import (
    Kinematics,
    addresses,
    displacement,
    put_gradients,
    steering,
)

_ROUNDING: Final = 1e-9  # part of a limit that rounding may add to it


class Signal(NamedTuple):
    """A wheel speed or another control over time ``(N,)`` for pictures; `axis` has its unit."""

    name: str
    axis: str
    values: Array
    limit: float

    @property
    def unit(self) -> str:
        """Unit of the quantity; empty where none is known."""
        return self.axis.partition(' [')[2].rstrip(']')


@dataclass(frozen=True)
class TwistLimits:
    """Bounds on the twists that can be driven: ``|v| + half_track |w| <= speed`` [m/s, rad/s].

    `half_track` is the speed lost to a unit turn rate [m]; with wheel limits (94) the paper's
    ``L``, by (91), and ``turn_rate`` is ``speed / half_track``. Negative for a point of the robot
    that is faster in turns.
    """

    speed: float
    turn_rate: float
    half_track: float = 0.0

    def __post_init__(self) -> None:
        bounds = (self.speed, self.turn_rate, self.half_track)
        if not all(map(math.isfinite, bounds)) or min(bounds[:2]) < 0.0:
            wanted = 'finite numbers, speed and turn rate >= 0'
            raise ValueError(f'twist limits: found {bounds}, wanted {wanted}')

    @property
    def top_speed(self) -> float:
        """Largest speed at any turn rate [m/s]."""
        return max(self.speed, self.speed - self.half_track * self.turn_rate)


@dataclass(frozen=True, kw_only=True)
class Robot(ABC):
    """A robot on wheels that drives an arc of a circle under a control that is held.

    Twists are ``(speed, turn rate)`` [m/s, rad/s]; of a robot whose reference point also moves
    sideways ``(forward, to the left, turn rate)``. A limit may be infinite.
    """

    n_controls: ClassVar[int] = 2  # number of controls, ``r``
    n_speeds: ClassVar[int] = 2  # how many, the first, are 0 at rest; the others are angles
    drives_sideways: ClassVar[bool] = False  # in every direction, without turning first
    turns_on_the_spot: ClassVar[bool] = True

    wheel_radius: float = 0.035  # of every wheel, the paper's ``r`` [m]
    max_wheel_speed: float = math.inf  # limit (94) of every wheel [rad/s]
    max_wheel_acceleration: float = math.inf  # limit of every wheel [rad/s^2]
    max_wheel_jerk: float = math.inf  # limit of its change with time [rad/s^3]
    max_lateral_acceleration: float = math.inf  # limit of speed times turn rate [m/s^2]

    @property
    @abstractmethod
    def constants(self) -> tuple[float, ...]:
        """Numbers that the model's functions are given, after the wheel radius."""

    @abstractmethod
    def functions(self) -> IntArray:
        """Addresses, in this process, of the model's functions; see `kinematics.addresses`."""

    @property
    def twist_parts(self) -> int:
        """Two or three."""
        return 3 if self.drives_sideways else 2

    @property
    @abstractmethod
    def half_track(self) -> float:
        """Speed at the wheels of a unit turn rate, or the smallest radius of a turn [m]."""

    @property
    def max_curvature(self) -> float:
        """Largest curvature of its path; infinite for a robot that turns on the spot [1/m]."""
        return math.inf if self.turns_on_the_spot else 1.0 / self.half_track

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

    @cached_property
    def kinematics(self) -> Kinematics:
        """The robot for compiled code."""
        return Kinematics(
            functions=self.functions(),
            values=np.array([self.wheel_radius, *self.constants], dtype=float),
            scratch=np.zeros((4, 3)),
            wheels=self.wheels,
            bounds=self.bounds.astype(float),
            n_speeds=self.n_speeds,
            max_wheel_speed=float(self.max_wheel_speed),
            max_speed=float(self.max_speed),
            max_lateral_acceleration=float(self.max_lateral_acceleration),
            max_curvature=self.max_curvature,
            drives_sideways=self.drives_sideways,
        )

    def __getstate__(self) -> dict[str, Any]:
        """Without addresses, which another process does not have."""
        return {key: value for key, value in self.__dict__.items() if key != 'kinematics'}

    @property
    @abstractmethod
    def wheels(self) -> Array:
        """Wheel speeds of a control, as a matrix ``(W, r)``: limits hold for each of its rows."""

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels in pictures."""
        return 'right', 'left'

    @cached_property
    def time_scaling(self) -> TimeScaling:
        """Time scaling of its controls along a path."""
        return TimeScaling(self.wheels, self.n_speeds)

    @property
    def rate_limits(self) -> Array:
        """Linear functions of the control that the acceleration limit holds for, ``(q, r)``."""
        return self.wheels

    def rates(self, wheel_speeds: Array) -> Array:
        """Values of `rate_limits` at wheel speeds ``(..., W)``."""
        return wheel_speeds

    @property
    def limit_rows(self) -> int:
        """Number of constraints of a stage on wheel speeds, beyond bounds of the controls."""
        return 0

    @property
    def lateral_rows(self) -> int:
        """Number of constraints of a stage on the lateral acceleration, left and right."""
        return 2 if self.max_lateral_acceleration < math.inf else 0

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

    def slipping(self, slip: float) -> Self:
        """The same robot with wheels that move it by a fraction ``1 - slip`` of their turning."""
        if not slip:
            return self
        lateral = (1.0 - slip) ** 2 * self.max_lateral_acceleration
        radius = (1.0 - slip) * self.wheel_radius
        return replace(self, wheel_radius=radius, max_lateral_acceleration=lateral)

    @abstractmethod
    def twist_limits(self) -> TwistLimits:
        """Twists that the wheel-speed limit allows; raises ValueError if there is none."""

    @abstractmethod
    def twist(self, controls: Array) -> Array:
        """Twists ``(..., 2)`` or ``(..., 3)`` of controls ``(..., r)``."""

    @abstractmethod
    def controls(self, twist: Array) -> Array:
        """Controls ``(..., r)`` of twists, of either form."""

    def speeds_of(self, controls: Array) -> Array:
        """Wheel speeds ``(..., W)`` [rad/s] of controls ``(..., r)``."""
        return np.asarray(controls @ self.wheels.T)

    def wheel_speeds(self, twist: Array) -> Array:
        """Wheel speeds ``(..., W)`` [rad/s] of twists, of either form."""
        return self.speeds_of(self.controls(twist))

    def twist_of_wheels(self, wheel_speeds: Array) -> Array:
        """Twists of wheel speeds ``(..., W)`` [rad/s], for a car with steering angles behind."""
        return self.twist(wheel_speeds)

    def wheel_differences(self, twists: Array, others: Array) -> Array:
        """By how much a wheel is faster or slower under some twists than others, ``(N,)``."""
        return np.asarray(np.abs(self.wheel_speeds(twists) - self.wheel_speeds(others)).max(axis=1))

    def signals(self, twists: Array) -> list[Signal]:
        """The speed of each wheel under twists ``(N, 2)`` or ``(N, 3)``."""
        speeds = zip(self.wheel_names, self.wheel_speeds(twists).T, strict=True)
        return [
            Signal(f'{name} wheel', 'wheel speed [rad/s]', values, self.max_wheel_speed)
            for name, values in speeds
        ]

    def with_slip(self, controls: Array, grip: Array) -> Array:
        """Controls that without slip move a robot as these do with such grip, right and left."""
        return self.slowed(controls, float(np.mean(grip)))

    def straight_or_turning(self, length: float, turn: float, time: float) -> Array:
        """Control ``(r,)`` that drives a length [m], or turns on the spot [rad], in a time [s]."""
        return self.controls(np.array([length, turn]) / time)

    def steering_of(self, control: Array) -> float | None:  # noqa: ARG002
        """Steering angle of a control, shape ``(r,)``; None for a robot that has none [rad]."""
        return None

    def lateral_acceleration(self, controls: Array) -> Array:
        """Speed along the path times turn rate under controls ``(..., r)``, ``(...)`` [m/s^2]."""
        twists = speeds_and_turns(self.twist(controls))
        return np.asarray(np.abs(twists[..., 0] * twists[..., 1]))

    def slowed_in_turns(self, controls: Array, part: float = 1.0) -> Array:
        """Controls ``(..., r)``, each slowed along its arc to a part of the lateral limit."""
        limit = part * self.max_lateral_acceleration
        if limit == math.inf or (across := self.lateral_acceleration(controls)).max() <= limit:
            return controls
        return self.slowed(controls, np.sqrt(limit / np.maximum(across, limit))[..., None])

    def slowed(self, controls: Array, fraction: float | Array) -> Array:
        """Controls ``(..., r)`` that drive the same arcs at a fraction of the speed."""
        slowed = controls.copy()
        slowed[..., : self.n_speeds] *= fraction
        return slowed

    def stopped(self, control: Array) -> Array:
        """The control, shape ``(r,)``, of a robot that comes to rest after another one."""
        return np.where(np.arange(self.n_controls) < self.n_speeds, 0.0, control)

    def over_limit(self, controls: Array) -> str:
        """A sentence about controls ``(N, r)`` beyond a limit that is not of wheels, or nothing."""
        limit = self.max_lateral_acceleration
        if limit == math.inf:
            return ''
        across = float(self.lateral_acceleration(controls[0]))
        if across <= limit * (1.0 + _ROUNDING):
            return ''
        return f'The plan has a lateral acceleration of {across!r} m/s^2, the limit is {limit!r}.'

    def limited(self, controls: Array) -> Array:
        """A control, shape ``(r,)``, slowed down along its arc to its limits."""
        limited, speeds = controls.copy(), slice(self.n_speeds)
        fastest = float(np.abs(self.wheels[:, speeds] @ controls[speeds]).max())
        if fastest > self.max_wheel_speed:
            # Divided first: the fastest wheel of a differential drive then has exactly the limit,
            # and rounding cannot lift the other above it.
            limited[speeds] = controls[speeds] / fastest * self.max_wheel_speed
        angles = slice(self.n_speeds, None)
        limited[angles] = np.clip(controls[angles], -self.bounds[angles], self.bounds[angles])
        return self.slowed_in_turns(limited)

    def all_limited(self, controls: Array, spare: float) -> Array:
        """Controls, shape ``(N, r)``, each slowed down to the wheels' limit less some [rad/s]."""
        fastest = np.abs(self.speeds_of(controls)).max(axis=1)
        limit = self.max_wheel_speed - spare
        return np.asarray(controls * np.minimum(1.0, limit / np.maximum(fastest, limit))[:, None])

    def roll_out(self, pose: Array, controls: Array, durations: Array) -> Array:
        """Poses ``(N + 1, 3)`` under controls ``(N, r)``, exactly; headings not wrapped."""
        poses = np.empty((len(durations) + 1, 3))
        poses[0] = pose
        kinematics.roll_out(poses, controls, durations, self.kinematics)
        return poses

    def jacobians(self, poses: Array, controls: Array, durations: Array) -> tuple[Array, Array]:
        """Derivatives ``A (N, 3, 3)`` and ``B (N, 3, r)`` of all steps by pose and control."""
        A = np.zeros((len(durations), 3, 3))
        B = np.zeros((len(durations), 3, self.n_controls))
        for k, duration in enumerate(durations.tolist()):
            heading = float(poses[k, 2])
            put_gradients(A[k], B[k], heading, controls, k, duration, self.kinematics)
        return A, B


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
