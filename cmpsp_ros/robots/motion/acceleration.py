"""Commands under a limit of the wheels' acceleration: ramps, braking, lag."""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free

_REST: Final = 1e-9  # speed of a wheel that rounding may leave of none [rad/s]
NO_RAMP: Array = np.zeros((0, 2))  # the ramp of a robot at rest, and of one that stops at once


class TimeScaling(NamedTuple):
    """Time scaling of a plan: the same path, driven more slowly.

    `wheels` are wheel speeds of a control, as a matrix ``(W, r)``. The first `scaled` controls are
    scaled; the others change by `steering` at most while a wheel changes by 1 rad/s.
    """

    wheels: Array
    scaled: int
    steering: float = math.inf


_BOTH_WHEELS: Final = TimeScaling(np.eye(2), 2)


def within_ramp(
    plan: Array,
    durations: Array,
    previous: Array,
    max_change: float,
    scaling: TimeScaling = _BOTH_WHEELS,
) -> Array:
    """Slow a plan ``(N + 1, r)`` down along its path until the wheels can follow it.

    Its last control moves nothing; its steps last `durations` ``(N,)`` [s]. `previous` ``(r,)`` is
    the command before it; `max_change` of wheel speeds between commands may be infinite [rad/s].
    """
    if max_change == math.inf:
        return plan
    commands, steps = plan.copy(), len(durations)
    pace = commands[:-1], plan, durations, durations, -1, previous, scaling, max_change, steps
    _pace(*pace, brakes=False)
    return commands


def smoothed(
    plan: Array, previous: Array, change: Array, limits: tuple[float, float, float], scaled: int
) -> Array:
    """Controls that follow a plan ``(N + 1, r)`` as closely as a limit of the wheels' jerk allows.

    `previous` ``(r,)`` is the command before, `change` its difference from the one before. `limits`
    are those of wheel speed, its change between commands, and the change of that [rad/s]. The first
    `scaled` controls are speeds of wheels; others are the plan's.
    """
    followed = plan.copy()
    fastest, most, jolt = (min(each, 1.0 / _REST) for each in limits)
    for a in range(scaled):
        now, step, before = float(previous[a]), float(change[a]), float(previous[a])
        for k, wanted in enumerate(plan[:, a].tolist()):
            late = before - now
            ahead = wanted - before + math.copysign(_last_changes(abs(late), jolt), late)
            ahead = min(ahead, _last_changes(max(fastest - now, 0.0), jolt), most)
            ahead = max(ahead, -_last_changes(max(fastest + now, 0.0), jolt), -most)
            step = min(max(ahead, step - jolt), step + jolt)
            now, before = min(max(now + step, -fastest), fastest), wanted
            followed[k, a] = now
    return followed


def _last_changes(left: float, jolt: float) -> float:
    """Largest of the changes that sum up to a difference, each less than the last by a jolt."""
    count = math.floor(0.5 * (math.sqrt(1.0 + 8.0 * left / jolt) - 1.0))
    return count * jolt + (left - 0.5 * jolt * count * (count + 1)) / (count + 1)


def braking(
    plan: Array,
    durations: Array,
    period: float,
    max_change: float,
    scaling: TimeScaling = _BOTH_WHEELS,
    *,
    along: bool,
) -> Array:
    """Compute commands ``(K, r)`` to rest after the first command of a plan; the last is 0.

    Args are those of `within_ramp`. Each command holds for `period` [s]. `along` brakes along the
    plan, as far as the wheels can follow it; else the curvature of its first command is kept.
    """
    fastest = math.ceil(float(np.abs(plan @ scaling.wheels.T).max()) / max_change)
    following = 2 * fastest if along else 0
    ramp = np.zeros((following + fastest + 1, plan.shape[1]))
    held = np.full(len(ramp), period)
    pace = ramp, plan, durations, held, 0, plan[0], scaling, max_change, following
    return ramp[: _pace(*pace, brakes=True)]


def least_scale(
    command: Array, previous: Array, max_change: float, scaling: TimeScaling = _BOTH_WHEELS
) -> float:
    """Least factor of a command ``(r,)`` that can follow a previous one; as `within_ramp`."""
    speeds = (scaling.wheels @ each for each in (command, previous))
    wheels = zip(*(each.tolist() for each in speeds), strict=True)
    least = [
        (math.copysign(before, before * to) - max_change) / abs(to) for to, before in wheels if to
    ]
    return min(max(0.0, *least), 1.0) if least else 0.0


def with_lag(
    controls: Array, commands: Array, held: Array, time_constant: float, slices: int
) -> tuple[Array, Array]:
    """Controls ``(K * slices, r)`` of wheels behind a first-order lag, and their durations [s].

    `controls` ``(r,)`` are in effect at first, and overwritten by the last. Each of the `commands`
    ``(K, r)`` lasts `held` ``(K,)`` [s]; `time_constant` > 0 [s].
    """
    means = np.empty((len(commands) * slices, commands.shape[1]))
    _lag(means, controls, np.ascontiguousarray(commands), held, time_constant, slices)
    return means, np.repeat(held / slices, slices)


@allocation_free
def _lag(
    means: Array, controls: Array, commands: Array, held: Array, time_constant: float, slices: int
) -> None:
    for k in range(commands.shape[0]):
        passed = held[k] / slices / time_constant
        left = math.exp(-passed)
        mean = (1.0 - left) / passed if passed > 0.0 else 1.0
        for i in range(slices):
            for a in range(commands.shape[1]):
                behind = controls[a] - commands[k, a]
                means[k * slices + i, a] = commands[k, a] + mean * behind
                controls[a] = commands[k, a] + left * behind


@allocation_free
def _pace(
    commands: Array,
    plan: Array,
    durations: Array,
    held: Array,
    step: int,
    before: Array,
    scaling: TimeScaling,
    max_change: float,
    following: int,
    brakes: bool,
) -> int:
    """Fill commands that follow a plan from the end of a step on, as fast as the wheels can.

    Each is the plan's at the place reached, scaled by the largest factor up to 1 that the limit
    allows, to brake by the least; where there is none the robot brakes along its curvature.
    """
    last, end, most = durations.shape[0] - 1, 0.0, int(commands.shape[0])
    scale, reached, wheels = 1.0, 0.0, scaling.wheels
    for count in range(most):
        fastest = _fastest(wheels, before)
        if brakes and fastest == 0.0:
            return count
        while step < last and end <= reached + 0.5 * scale * held[count]:
            step += 1
            end += durations[step]
        low, high = 0.0, 1.0
        for i in range(wheels.shape[0]):
            wanted, has = _speed(wheels, i, plan[step]), _speed(wheels, i, before)
            low, high = _scales(wanted, has, max_change, low, high)
        now = commands[count]
        if count < following and low <= high:
            scale = low if brakes else high
            for a in range(scaling.scaled):
                now[a] = scale * plan[step, a]
            for a in range(scaling.scaled, plan.shape[1]):
                most_steered = max_change * scaling.steering
                change = plan[step, a] - before[a]
                now[a] = before[a] + min(max(change, -most_steered), most_steered)
        else:
            slower = max(0.0, 1.0 - max_change / fastest)
            scale *= slower
            for a in range(plan.shape[1]):
                now[a] = slower * before[a] if a < scaling.scaled else before[a]
        if brakes and _fastest(wheels, now) < _REST:
            for a in range(scaling.scaled):
                now[a] = 0.0
        before = now
        reached += scale * held[count]
    return most


@allocation_free
def _speed(wheels: Array, i: int, control: Array) -> float:
    speed = 0.0
    for a in range(control.shape[0]):
        speed += wheels[i, a] * control[a]
    return speed


@allocation_free
def _fastest(wheels: Array, control: Array) -> float:
    fastest = 0.0
    for i in range(wheels.shape[0]):
        fastest = max(fastest, abs(_speed(wheels, i, control)))
    return fastest


@allocation_free
def _scales(wanted: float, before: float, max_change: float, low: float, high: float) -> Any:
    """Range of factors of a wheel's speed that a limit allows, within another range."""
    if wanted == 0.0:
        return low, high if abs(before) <= max_change else -1.0
    one, other = (before - max_change) / wanted, (before + max_change) / wanted
    return max(low, min(one, other)), min(high, max(one, other))
