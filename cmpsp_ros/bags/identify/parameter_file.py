"""Parameter file of a robot that was identified, as those in config/robots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.identify.estimates import Identification
from cmpsp_ros.parameters.files import dump


def write_parameters(path: Path, robot: Identification) -> None:
    """Write what is known; what is not is a comment.

    Raises:
        BagError: The file cannot be written.
    """
    drives = ''.join(f'# {each.label}, {each.stamps[-1]:.0f} s\n' for each in robot.drives)
    head = f'# By `cmpsp identify`, intervals of 95 %, from\n{drives}\n/**:\n  ros__parameters:\n'
    try:
        path.write_text(head + '\n'.join(_lines(robot)) + '\n', encoding='utf-8')
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror or error}') from error


def _lines(robot: Identification) -> Iterator[str]:
    """Each estimate as a comment, and below it the parameters that follow from it."""
    known = {key: each.interval for key, each in robot.estimates.items()}
    values, hints = _parameters(robot)
    for key, each in robot.estimates.items():
        figures = f'{known[key]} {each.unit}'.rstrip() if known[key] else ''
        yield f'    # {each.name}: {", ".join(filter(None, (figures, each.remark)))}.'
        yield from (f'    # {hint}' for hint in hints.get(key, ()))
        if key in values:
            yield dump({values[key][0]: round(values[key][1], 4)}).splitlines()[-1]
    yield "    # The paper's constant wheel speeds are another robot's."
    yield dump({'initial_guess.type': 'road'}).splitlines()[-1]
    yield dump({'enable_stamped_cmd_vel': robot.drives[0].stamped}).splitlines()[-1]


def _parameters(
    robot: Identification,
) -> tuple[dict[str, tuple[str, float]], dict[str, tuple[str, ...]]]:
    """Parameters and values, and what is said of them, by the key of the estimate."""
    known = {key: each.interval.value for key, each in robot.estimates.items() if each.interval}
    values: dict[str, tuple[str, float]] = {}
    hints: dict[str, tuple[str, ...]] = {}
    if 'command_delay' in known:
        values['command_delay'] = 'command_delay', max(known['command_delay'], 0.0)
    lag = robot.estimates['lag'].interval
    if lag is not None:
        hints['lag'] = (
            'Included in command_delay. Apart from it, with command_delay less the lag:',
            f'max_wheel_lag: {lag.high:.4g}',
        )
    linear, angular = known.get('linear_scale'), known.get('angular_scale')
    radius, half_track = map(robot.nominal.get, ('robot.wheel_radius', 'robot.half_track'))
    hints['linear_scale'] = ('robot.wheel_radius: that of the driver times this.',)
    hints['angular_scale'] = (
        'robot.half_track: that of the driver times the linear scale, divided by this.',
    )
    same = ('Its driver must have the same value: it makes wheel speeds of twists.',)
    if linear and radius:
        values['linear_scale'] = 'robot.wheel_radius', radius * linear
        hints['linear_scale'] = same
        for kind in ('speed', 'acceleration'):
            if f'linear_{kind}' in known:
                limit = known[f'linear_{kind}'] / (radius * linear)
                values[f'linear_{kind}'] = f'robot.max_wheel_{kind}', limit
        if angular and half_track:
            values['angular_scale'] = 'robot.half_track', half_track * linear / angular
            hints['angular_scale'] = same
    return values, hints
