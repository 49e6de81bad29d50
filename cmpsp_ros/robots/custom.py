"""Custom models: their motion and steering, limits, and whether these fit together."""

import inspect
import math
import sys
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from itertools import product
from typing import Any, ClassVar, Final, Self

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.motion.acceleration import TimeScaling
from cmpsp_ros.robots.motion.arcs import with_side
from cmpsp_ros.robots.robot import DerivedRobot, Signal, TwistLimits

_SAMPLES: Final = 21
_ALL: Final = 1.01  # by which bounds of all twists are larger than those of the samples
_STOPPED: Final = 1e-9
_NUMBERS: Final = 2, 3
_PARTS: Final = (0.5, 0.3, -0.2), (0.9, -0.6, 0.4), (0.2, 0.1, 0.7)
"""Parts of their limits at which controls are tried."""

_SIGNS: Final = 1.0, -1.0
_TWIST: Final = 'speed forward', 'speed to the left', 'turn rate'
_STEP: Final = 1e-5
_TINY: Final = 1e-100
_TOLERANCE: Final = 1e-6
_MODELS: Final = (
    'differential_drive, mecanum, omni_wheels, ackermann or my_package.my_module:MyRobot'
)


@dataclass(frozen=True, kw_only=True)
class CustomRobot(DerivedRobot):
    """A robot whose controls, while they are held, give it a twist that depends on them alone.

    Its "wheels" are its controls as parts of their limits, in messages too, and its wheel radius is
    1, or less where they slip. A class derived from it also has `motion` and `steer`, and finds all
    parameters by their keys in `parameters`.
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
        return np.asarray(wheel_speeds * self.bounds @ self.rate_limits.T)

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
        return np.asarray(off.max(axis=1))

    def speeds_of(self, controls: Array) -> Array:
        """Controls as parts of their limits, ``(..., r)``."""
        return np.asarray(controls / self.bounds)

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


class ModelError(ValueError):
    """A model cannot be used; the arguments are the value found and the one wanted."""


def custom_model(name: str) -> type[CustomRobot]:
    """The class of a name such as `my_package.my_module:MyRobot`, or a `ModelError`."""
    module, colon, wanted = name.partition(':')
    if not colon or not module or not wanted:
        raise ModelError(repr(name), _MODELS)
    try:
        found = getattr(import_module(module), wanted)
    except ImportError as error:
        raise ModelError(f'{module!r}, which cannot be imported: {error}', 'a module') from error
    except AttributeError:
        raise ModelError(f'no {wanted!r} in {module}', 'a class in that module') from None
    if not isinstance(found, type) or not issubclass(found, CustomRobot):
        raise ModelError(repr(name), 'a class derived from cmpsp_ros.robots.CustomRobot')
    return found


def custom_robot(name: str, parameters: Mapping[str, Any]) -> CustomRobot:
    """The robot of a custom class; ModelError if there is none, or its parts do not fit."""
    try:
        robot = custom_model(name).of(parameters)
        _check(name, robot)
    except ModelError:
        raise
    except Exception as error:
        # A custom class may raise anything.
        said = str(error).strip().partition('\n')[0]
        found = f'{name}, which raises {type(error).__name__}: {said}'
        raise ModelError(found, 'a model as in doc/user/your_model.md') from error
    return robot


def _check(name: str, robot: CustomRobot) -> None:
    r = robot.n_controls
    if r not in _NUMBERS or not 1 <= robot.n_speeds <= r:
        found = f'{name} with n_controls {r} and n_speeds {robot.n_speeds}'
        raise ModelError(found, 'two or three controls, of which one at least is a speed')
    highest = [sys.float_info.max] * robot.n_speeds + [math.pi] * (r - robot.n_speeds)
    _check_limits(name, robot, 'limits', highest, 'finite, of angles at most pi')
    _check_limits(name, robot, 'change_limits', [math.inf] * r, 'inf for none')
    if np.ndim(robot.constants) != 1:
        raise ModelError(f'{name} with constants {robot.constants!r}', 'numbers in a tuple')
    _check_slopes(name, robot, np.zeros(r))
    for part, sign in product(_PARTS, _SIGNS):
        controls = (
            robot.bounds
            * np.array(part[:r])
            * ([sign] * robot.n_speeds + [1.0] * (r - robot.n_speeds))
        )
        _check_slopes(name, robot, controls)
        _check_steering(name, robot, controls)
    if robot.drives_sideways and robot.twist_parts < len(_TWIST):
        raise ModelError(f'{name} with drives_sideways, but no speed to the left', 'one of both')
    # Compilation fails here, before anything drives.
    _ = robot.kinematics


def _check_limits(
    name: str, robot: CustomRobot, what: str, highest: Sequence[float], range_: str
) -> None:
    given = getattr(robot, what)
    if (
        np.ndim(given) != 1
        or len(given) != robot.n_controls
        or not all(0.0 < each <= most for each, most in zip(given, highest, strict=True))
    ):
        wanted = f'{robot.n_controls} numbers above 0, {range_}'
        raise ModelError(f'{name} with {what} {given}', wanted)


def _check_steering(name: str, robot: CustomRobot, controls: Array) -> None:
    twist = robot.twist(controls)
    given = robot.steer(robot.constants, *with_side(twist).tolist())
    if np.shape(given) != (robot.n_controls,):
        found = f'{name}, of which steer answers {given!r}'
        raise ModelError(found, f'{robot.n_controls} controls')
    again = robot.twist(robot.controls(twist))
    if not np.allclose(again, twist, rtol=0.0, atol=_TOLERANCE * (1.0 + np.abs(twist).max())):
        found = f'{name}, of which steer answers {twist} with controls that give {again}'
        raise ModelError(found, 'the controls of that twist')


def _check_slopes(name: str, robot: CustomRobot, controls: Array) -> None:
    """Compiled code takes derivatives by an imaginary step, which not every function survives."""
    twist = robot.motion(robot.constants, *controls.tolist())
    if np.shape(twist) != (len(_TWIST),):
        raise ModelError(f'{name}, of which motion answers {twist!r}', ', '.join(_TWIST))
    for a, limit in enumerate(robot.limits):
        step = np.zeros(robot.n_controls)
        step[a] = _STEP * limit
        ahead, behind = (robot.motion(robot.constants, *(controls + s)) for s in (step, -step))
        wanted = (np.array(ahead) - np.array(behind)) / (2.0 * step[a])
        imaginary = [complex(each, _TINY * (b == a)) for b, each in enumerate(controls.tolist())]
        found = np.imag(robot.motion(robot.constants, *imaginary)) / _TINY
        if not np.allclose(found, wanted, rtol=0.0, atol=_TOLERANCE * (1.0 + np.abs(wanted).max())):
            said = f'{name}, of which motion has derivatives {found} that should be {wanted}'
            raise ModelError(
                said, 'smooth functions of numpy, without abs, min, max or comparisons'
            )
