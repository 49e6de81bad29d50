"""Custom models: finding the class, and checking that its parts fit together."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from itertools import product
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots.arcs import with_side
from cmpsp_ros.robots.custom import CustomRobot

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
    """The robot of a custom class, once its parts are known to fit together.

    Raises:
        ModelError: They do not, or there is no such class.
    """
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
