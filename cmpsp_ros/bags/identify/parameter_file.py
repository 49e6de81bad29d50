"""Parameter file of a robot that was identified, as those in config/robots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.identify.estimates import Identification
from cmpsp_ros.bags.identify.intervals import Interval
from cmpsp_ros.parameters.ros_yaml import dump

_SAME_IN_DRIVER: Final = 'Its driver must have the same value: it makes wheel speeds of a twist.'
_DIGITS: Final = 4


def write_parameters(path: Path, robot: Identification) -> None:
    """Write what is known; what is not is a comment.

    Raises:
        BagError: The file cannot be written.
    """
    drives = '\n'.join(f'# {each.label}, {each.stamps[-1]:.0f} s' for each in robot.drives)
    lines = [
        f'# By `cmpsp identify`, intervals of 95 %:\n{drives}\n\n/**:\n  ros__parameters:',
        *_entries(robot),
        # ROS takes no section without a parameter.
        f'    # Commands were {"TwistStamped" if robot.stamped else "Twist"}.',
        _entry('enable_stamped_cmd_vel', robot.stamped),
    ]
    try:
        path.write_text('\n'.join(lines) + '\n', encoding='utf-8')
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror or error}') from error


def _entries(robot: Identification) -> Iterator[str]:
    delay = robot.known('command_delay')
    if delay is None:
        yield f'    # command_delay: {robot.estimates["command_delay"].remark}.'
    else:
        remark = robot.estimates['command_delay'].remark
        yield f'    # {remark[0].upper()}{remark[1:]}. {_between(delay, "s")}'
        yield _entry('command_delay', max(delay.value, 0.0))
    lag = robot.known('lag')
    if lag is not None and lag.high > 0.0:
        yield f'    # Wheel lag, which is in command_delay: {_between(lag, "s")} Guidance estimates'
        yield '    # one by itself if there is no command_delay:'
        yield f'    # max_wheel_lag: {round(lag.high, _DIGITS)}'
    yield from _wheels(robot)


def _wheels(robot: Identification) -> Iterator[str]:
    linear, angular = robot.known('scale_linear'), robot.known('scale_angular')
    radius, half_track = map(robot.nominal.get, ('robot.wheel_radius', 'robot.half_track'))
    for scale, name in ((linear, 'linear'), (angular, 'angular')):
        if scale is None:
            yield f'    # {name} scale: {robot.estimates[f"scale_{name}"].remark}.'
        else:
            yield f'    # {name} scale, driven by commanded: {_between(scale, "")}'
    if linear is None or radius is None:
        yield '    # robot.wheel_radius: that of its driver times the linear scale.'
        yield '    # robot.half_track: that of its driver times linear scale / angular scale.'
    if linear is None:
        return
    if radius is not None:
        radius *= linear.value
        yield f'    # {_SAME_IN_DRIVER}'
        yield _entry('robot.wheel_radius', radius)
        if angular is not None and half_track is not None:
            yield _entry('robot.half_track', half_track * linear.value / angular.value)
    for kind, key in (('speed', 'max_wheel_speed'), ('acceleration', 'max_wheel_acceleration')):
        estimate = robot.estimates[f'{kind}_linear']
        if estimate.interval is None:
            yield f'    # robot.{key}: {estimate.remark}.'
        elif radius is None:
            between = _between(estimate.interval, estimate.unit)
            yield f'    # robot.{key}: divide by the wheel radius: {between}'
        else:
            yield f'    # {_between(estimate.interval, estimate.unit)}'
            yield _entry(f'robot.{key}', estimate.interval.value / radius)


def _between(interval: Interval, unit: str) -> str:
    value, low, high = interval.figures
    return f'{value} {unit} ({low} to {high}).'.replace('  ', ' ')


def _entry(key: str, value: float | bool) -> str:
    kept = value if isinstance(value, bool) else round(value, _DIGITS)
    return dump({key: kept}).splitlines()[-1]
