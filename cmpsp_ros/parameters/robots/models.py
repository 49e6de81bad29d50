"""The robot that parameters describe: the one list of its models, and the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.table import Values

if TYPE_CHECKING:
    from cmpsp_ros.robots import Robot

_FEWEST_WHEELS: Final = 3
_SINGULAR: Final = 1e-6


def robot_of(values: Values) -> Robot:
    """The robot, of the model that `robot.model` names.

    Raises:
        ParameterError: It is a class of one's own that cannot be used.
    """
    model = values['robot.model']
    if model in MODELS:
        return MODELS[model](values)
    from cmpsp_ros.robots.own import ModelError, own_robot  # noqa: PLC0415 (loads numba)

    try:
        return own_robot(model, values)
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
        from cmpsp_ros.robots.own import own_model  # noqa: PLC0415 (loads numba)

        return own_model(values['robot.model']).n_controls
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
