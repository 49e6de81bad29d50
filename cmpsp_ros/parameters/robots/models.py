"""The robot that parameters describe: the one list of its models, and the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.parameter import Group, Parameter, ParameterType, Range
from cmpsp_ros.parameters.table import Values

if TYPE_CHECKING:
    from cmpsp_ros.robots import Robot

_DOUBLE, _DOUBLES = ParameterType.DOUBLE, ParameterType.DOUBLE_ARRAY
_STRING, _STRINGS = ParameterType.STRING, ParameterType.STRING_ARRAY

_POSITIVE: Final = Range(low=0.0, low_open=True)
_NOT_NEGATIVE: Final = Range(low=0.0)

_FIXED: Final = {'reconfigurable': False}

_FEWEST_WHEELS: Final = 3
_SINGULAR: Final = 1e-6


def robot_of(values: Values) -> Robot:
    """The robot, of the model that `robot.model` names.

    Raises:
        ParameterError: It is a custom model that cannot be used.
    """
    model = values['robot.model']
    if model in MODELS:
        return MODELS[model](values)
    from cmpsp_ros.robots import ModelError, custom_robot  # noqa: PLC0415 (loads numba)

    try:
        return custom_robot(model, values)
    except ModelError as error:
        raise ParameterError(Problem('robot.model', *error.args)) from error


def robot_problems(values: Values) -> Iterator[Problem]:
    """What the model that is chosen cannot do without, and what it cannot do."""
    model = values['robot.model']
    if model not in MODELS:
        robot_of(values)
    names, wheels = values['robot.joint_names'], _n_wheels(values)
    if len(names) != wheels:
        yield Problem('robot.joint_names', describe(names), f'{wheels} names, one a wheel')
    if model == 'mecanum' and values['robot.half_wheel_base'] == 0.0:
        yield Problem('robot.half_wheel_base', '0.0 m', 'a distance above 0 for a mecanum robot')
    if model == 'omni_wheels':
        yield from _bearing_problems(values['robot.wheel_bearings'])
    if model == 'ackermann':
        yield from _car_problems(values)
    if model == 'differential_drive':
        return
    if values['initial_guess.type'] == 'constant':
        wanted = f'road, for the wheel speeds of constant are not those of robot.model {model}'
        yield Problem('initial_guess.type', "'constant'", wanted)
    if values['plant'] == 'mujoco':
        yield Problem('plant', "'mujoco'", f'kinematic for robot.model {model}')


def _n_wheels(values: Values) -> int:
    bearings = values['robot.wheel_bearings']
    if values['robot.model'] not in MODELS:
        from cmpsp_ros.robots import custom_model  # noqa: PLC0415 (loads numba)

        return custom_model(values['robot.model']).n_controls
    others = {'mecanum': 4, 'omni_wheels': len(bearings), 'ackermann': 1}
    return others.get(values['robot.model'], 2)


def _car_problems(values: Values) -> Iterator[Problem]:
    for key in ('robot.wheel_base', 'robot.max_steering_angle'):
        if values[key] < _SINGULAR:
            yield Problem(key, describe(values[key]), f'{_SINGULAR:.0e} or more for a car')
    rate, acceleration = values['robot.max_steering_rate'], values['robot.max_wheel_acceleration']
    if rate and not acceleration:
        wanted = 'above 0 where robot.max_steering_rate is'
        yield Problem('robot.max_wheel_acceleration', describe(acceleration), wanted)
    if values['goal.hold']:
        yield Problem('goal.hold', 'true', 'false for a car: it cannot turn where it stands')


def _bearing_problems(bearings: list[float]) -> Iterator[Problem]:
    rows = [(-math.sin(each), math.cos(each), 1.0) for each in bearings]
    if len(rows) < _FEWEST_WHEELS or np.linalg.svd(rows, compute_uv=False)[-1] < _SINGULAR:
        wanted = 'three or more directions, of which three differ'
        yield Problem('robot.wheel_bearings', describe(bearings), wanted)


def _of_wheels(values: Values) -> dict[str, float]:
    speed, acceleration = values['robot.max_wheel_speed'], values['robot.max_wheel_acceleration']
    return {
        'wheel_radius': values['robot.wheel_radius'],
        'max_wheel_speed': speed or math.inf,
        'max_wheel_acceleration': acceleration or math.inf,
    }


def _differential_drive(values: Values) -> Robot:
    from cmpsp_ros.robots import DifferentialDrive  # noqa: PLC0415 (loads numba)

    return DifferentialDrive(half_track=values['robot.half_track'], **_of_wheels(values))


def _mecanum(values: Values) -> Robot:
    from cmpsp_ros.robots import mecanum  # noqa: PLC0415 (loads numba)

    half_track, half_wheel_base = values['robot.half_track'], values['robot.half_wheel_base']
    return mecanum(half_track, half_wheel_base, **_of_wheels(values))


def _omni_wheels(values: Values) -> Robot:
    from cmpsp_ros.robots import on_omni_wheels  # noqa: PLC0415 (loads numba)

    distance, bearings = values['robot.half_track'], values['robot.wheel_bearings']
    return on_omni_wheels(distance, bearings, **_of_wheels(values))


def _ackermann(values: Values) -> Robot:
    from cmpsp_ros.robots import Ackermann  # noqa: PLC0415 (loads numba)

    return Ackermann(
        wheel_base=values['robot.wheel_base'],
        max_steering_angle=values['robot.max_steering_angle'],
        max_steering_rate=values['robot.max_steering_rate'] or math.inf,
        **_of_wheels(values),
    )


MODELS: Final[Mapping[str, Callable[[Values], Robot]]] = MappingProxyType(
    {
        'differential_drive': _differential_drive,
        'mecanum': _mecanum,
        'omni_wheels': _omni_wheels,
        'ackermann': _ackermann,
    }
)
"""All models of robots by their names in `robot.model`."""


# fmt: off
def robot_parameters() -> Iterator[Parameter]:
    """Rows of the table, in the order of the documentation."""
    guidance_only = {'nodes': ('guidance',)}
    robot = Group('Robot', 'guidance', 'sim')
    yield robot('robot.model', _STRING, 'differential_drive', '',
        'How the robot moves: `differential_drive` on two driven wheels, `mecanum` on four, '
        '`omni_wheels` on three or more, `ackermann` steered like a car; or a class of your own, '
        '`my_package.my_module:MyRobot`.', **_FIXED)
    yield robot('robot.wheel_radius', _DOUBLE, 0.035, 'm',
        'Radius of each wheel: `r` = 35 mm in the paper.', range=_POSITIVE)
    yield robot('robot.half_track', _DOUBLE, 0.055, 'm',
        "Distance from a wheel to the robot's centre: `L` = 55 mm in the paper. Of a `mecanum` "
        'robot to the side; of one on `omni_wheels` in the direction of the wheel.',
        range=_POSITIVE)
    yield robot('robot.half_wheel_base', _DOUBLE, 0.0, 'm',
        "Distance from the robot's centre to a wheel of a `mecanum` robot, ahead or behind.",
        range=_NOT_NEGATIVE)
    yield robot('robot.wheel_base', _DOUBLE, 0.0, 'm',
        "Distance of an `ackermann` robot's axles; odometry is that of the middle of the rear one.",
        range=_NOT_NEGATIVE)
    yield robot('robot.max_steering_angle', _DOUBLE, 0.0, 'rad',
        'Limit of the steering angle of an `ackermann` robot, of one front wheel in the middle.',
        range=Range(0.0, 1.5))
    yield robot('robot.max_steering_rate', _DOUBLE, 0.0, 'rad/s',
        'Limit of its change, from one command to the next; needs `robot.max_wheel_acceleration`. '
        '0: no limit.', range=_NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield robot('robot.wheel_bearings', _DOUBLES, [], 'rad',
        'Directions from the centre to the `omni_wheels`, 0 ahead and counterclockwise.')
    yield robot('robot.max_wheel_speed', _DOUBLE, 51.0, 'rad/s',
        'Limit of each wheel, in both directions: 51 rad/s in the paper; 0: no limit.',
        range=_NOT_NEGATIVE)
    yield robot('robot.max_wheel_acceleration', _DOUBLE, 0.0, 'rad/s^2',
        "Limit of each wheel's acceleration, from one command to the next and in a stop; the "
        'braking path must be clear, too. 0: no limit, and immediate stops. A value above 0 '
        'compiles its own kernels.',
        range=_NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield robot('robot.radius', _DOUBLE, 0.0, 'm',
        "Radius of the robot's footprint. Obstacles are enlarged and the road is narrowed by it.",
        range=_NOT_NEGATIVE)
    yield robot('robot.footprint', _STRING, '', 'm',
        'Corners of the footprint as Nav2 writes them, `"[[x1, y1], [x2, y2], ...]"`: ahead and to '
        'the left of the place that odometry is of. Five discs at most cover it. `robot.radius` '
        'does not count with it. Empty: a disc of that radius.')
    yield robot('robot.joint_names', _STRINGS, ['wheel_right_joint', 'wheel_left_joint'], '',
        'Names of the wheel joints in the wheel-speed message: right, left; of a `mecanum` robot '
        'front left, front right, rear right, rear left; of an `ackermann` robot that of the rear '
        'axle; else in the order of `robot.wheel_bearings`.',
        **_FIXED, **guidance_only)
# fmt: on
