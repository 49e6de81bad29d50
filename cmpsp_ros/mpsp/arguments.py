"""The error of this package, and numbers from users brought to the shapes of the method."""

import math

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array


class ProblemError(ValueError):
    """A problem, guess or setting the method cannot work with; the message names the argument."""


def numbers(name: str, value: ArrayLike) -> Array:
    """A copy of `value` as an array of numbers; `ProblemError` names the argument."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise ProblemError(f'{name}: found {value!r}, wanted numbers') from None


def not_finite(name: str, array: Array, *, at_end: bool = False) -> str:
    """The first number of an array that is not finite, and where; empty where all are finite.

    The array has one row a stage, or with `at_end` is all of the last stage.
    """
    # The sum of squares propagates what is not finite, in half the time; it may overflow.
    if math.isfinite(np.vdot(array, array)) or not len(bad := np.argwhere(~np.isfinite(array))):
        return ''
    place = bad[0].tolist()
    stage = [] if at_end else [f'stage {place.pop(0)}']
    where = [*stage, 'component ' + ', '.join(map(str, place))]
    return f'{name}: found {array[tuple(bad[0])]} at {", ".join(where)}'


def check_bounds(lower_name: str, lower: Array, upper_name: str, upper: Array) -> None:
    """Raise `ProblemError` unless a number lies between every lower bound and its upper one."""
    if ((lower <= upper) & (lower < np.inf) & (upper > -np.inf)).all():
        return
    for name, bound in ((lower_name, lower), (upper_name, upper)):
        bad = np.argwhere(np.isnan(bound))
        if len(bad):
            raise ProblemError(f'{name}: found nan at {bad[0].tolist()}, wanted a number')
    bad = np.argwhere((lower > upper) | np.isposinf(lower) | np.isneginf(upper))
    if len(bad):
        place = tuple(bad[0])
        raise ProblemError(
            f'{lower_name}: found {lower[place]} at {bad[0].tolist()}, '
            f'wanted a number below {upper_name}, which is {upper[place]} there'
        )


def whole_number(name: str, value: object) -> int:
    """`value` where it is a whole number of at least 1, else a `ProblemError`."""
    if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
        raise ProblemError(f'{name}: found {value!r}, wanted a whole number of at least 1')
    return int(value)


def vector(name: str, value: ArrayLike, length: int | None = None) -> Array:
    """A copy of `value` as a vector of finite numbers, else a `ProblemError`."""
    array = numbers(name, value)
    if array.ndim != 1 or (length is not None and len(array) != length):
        wanted = 'a vector' if length is None else (length,)
        raise ProblemError(f'{name}: found shape {array.shape}, wanted {wanted}')
    if not np.isfinite(array).all():
        raise ProblemError(f'{name}: found {array}, wanted finite numbers')
    return array


def control_bounds(
    lower: ArrayLike | None, upper: ArrayLike | None, shape: tuple[int, int]
) -> tuple[Array, Array]:
    """Bounds on all controls, each from None, a number, shape ``(r,)`` or `shape` = ``(N + 1, r)``.

    Raises:
        ProblemError: Names the argument, with the value found and the one wanted.
    """
    least = _bound('lower', -np.inf if lower is None else lower, shape)
    largest = _bound('upper', np.inf if upper is None else upper, shape)
    check_bounds('lower', least, 'upper', largest)
    return least, largest


def free_final_time(
    final_time: ArrayLike | None, x0: ArrayLike, lower: Array, upper: Array, phases: int
) -> tuple[Array, Array, Array]:
    """Initial state and bounds with the final time as last state, and its change as last control.

    It changes at stage 0, from the guess; `final_time` is the least, guessed and largest one, or
    a row of them for each of several phases.
    """
    given = np.nan if final_time is None else final_time
    times = np.atleast_2d(numbers('final_time', given)).T
    is_ordered = times.shape == (3, phases) and (times[0] > 0.0).all()
    if not (is_ordered and (times[0] <= times[1]).all() and (times[1] <= times[2]).all()):
        order = '0 < least <= guess <= largest' + (phases > 1) * f' for {phases} phases'
        raise ProblemError(f'final_time: found {final_time!r}, wanted {order}')
    least, guess, largest = times
    change = np.zeros((2, len(lower), phases))
    change[:, 0] = least - guess, largest - guess
    start = np.append(vector('x0', x0), guess)
    return start, np.hstack([lower, change[0]]), np.hstack([upper, change[1]])


def _bound(name: str, value: ArrayLike, shape: tuple[int, int]) -> Array:
    array = numbers(name, value)
    if array.shape not in {(), shape[1:], shape}:
        raise ProblemError(f'{name}: found shape {array.shape}, wanted {shape[1:]} or {shape}')
    return np.broadcast_to(array, shape).copy()


def terminal_target(target: ArrayLike | None, outputs: int | None) -> Array:
    """``Y_N*`` of (5), empty where there is no output; `outputs` is ``m``, None without an ``h``.

    Raises:
        ProblemError: One was given without the other, or they do not fit.
    """
    if outputs is None:
        if target is not None:
            raise ProblemError('h: found none with a target, wanted the output that is to reach it')
        return np.empty(0)
    if target is None:
        raise ProblemError(f'target: found none with an h, wanted shape {(outputs,)}')
    return vector('target', target, outputs)
