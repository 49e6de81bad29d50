"""Derivatives of a user's function of one stage, by complex step or by central differences."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.errors import ProblemError

Scheme = Literal['complex_step', 'central']

_COMPLEX_STEP = 1e-30
# Least sum of truncation and rounding: of a first difference, and of a difference of differences.
STEP = float(np.finfo(float).eps ** (1.0 / 3.0))
_TWICE = float(np.finfo(float).eps ** (1.0 / 4.0))
_AGREEMENT = 1e-5


class StageFunction:
    """A function ``(k, x, u)`` of the user's as one of ``k`` and ``Z_k = (X_k, U_k)``.

    Attributes:
        name: What the user calls it.
        shape: Of its value.
        scheme: How it is differentiated.
    """

    scheme: Scheme = 'central'

    def __init__(
        self, name: str, function: Callable[..., Any], states: int, shape: tuple[int, ...]
    ) -> None:
        """Take the function, the number of states in ``Z_k``, and the shape of the value."""
        self.name = name
        self.shape = shape
        self._function = function
        self._states = states

    def __call__(self, k: int, Z: NDArray[Any]) -> NDArray[Any]:
        """The value: NaN where Python's arithmetic raises, complex where ``Z`` is.

        Raises:
            ProblemError: The value has the wrong shape or is no number.
        """
        try:
            with np.errstate(all='ignore'):
                # Copies: the function may work in place.
                found = self._function(k, Z[: self._states].copy(), Z[self._states :].copy())
        except ArithmeticError:
            nan = complex(np.nan, np.nan) if np.iscomplexobj(Z) else np.nan
            return np.full(self.shape, nan)
        try:
            value = np.array(found, dtype=Z.dtype)
        except (TypeError, ValueError) as error:
            raise ProblemError(
                f'{self.name}: found {found!r} at stage {k}, wanted numbers'
            ) from error
        if value.shape != self.shape:
            raise ProblemError(
                f'{self.name}: found shape {value.shape} at stage {k}, wanted {self.shape}'
            )
        return value

    def jacobian(self, k: int, Z: Array) -> Array:
        """First derivatives, shape ``shape + (n + r,)``."""
        if self.scheme == 'complex_step':
            return _complex_step(self, k, Z)
        return central_differences(partial(self, k), Z)

    def hessian(self, k: int, Z: Array) -> Array:
        """Second derivatives of a scalar function by differences of its gradient, symmetric."""
        if self.scheme == 'complex_step':
            second = central_differences(partial(_complex_step, self, k), Z)
        else:
            gradient = partial(central_differences, partial(self, k), relative_step=_TWICE)
            second = central_differences(gradient, Z, _TWICE)
        return 0.5 * (second + second.T)

    def choose_scheme(self, probes: Iterable[tuple[int, Array]]) -> None:
        """Take the complex step if it agrees with differences at all probes, else differences.

        Probes at which the function or its derivatives are not finite count for nothing; without
        any left, differences are taken.
        """
        self.scheme = 'central'
        agreed = False
        for k, Z in probes:
            expected = central_differences(partial(self, k), Z)
            if not np.isfinite(expected).all():
                continue
            try:
                with warnings.catch_warnings():
                    warnings.simplefilter('error', np.exceptions.ComplexWarning)
                    found = _complex_step(self, k, Z)
            # Any error on complex numbers means that the function does not take them.
            except Exception:
                return
            if not np.allclose(found, expected, rtol=_AGREEMENT, atol=_AGREEMENT):
                return
            agreed = True
        if agreed:
            self.scheme = 'complex_step'


def _complex_step(function: Callable[[int, NDArray[Any]], NDArray[Any]], k: int, Z: Array) -> Array:
    """``Im f(Z + i h e_j) / h``: no difference is taken, so nothing cancels."""
    columns = []
    for j in range(len(Z)):
        at = Z.astype(complex)
        at[j] += 1j * _COMPLEX_STEP
        columns.append(function(k, at).imag / _COMPLEX_STEP)
    return np.stack(columns, axis=-1)


def central_differences(
    function: Callable[[Array], NDArray[Any]],
    at: Array,
    relative_step: float = STEP,
    places: Iterable[tuple[int, ...]] | None = None,
) -> Array:
    """Derivatives by components of ``at``, along a last axis.

    Args:
        function: What is differentiated.
        at: Where.
        relative_step: Step, relative to 1 plus the size of the component.
        places: Which components; None for all.
    """
    columns = []
    for place in np.ndindex(at.shape) if places is None else places:
        ahead, behind = at.copy(), at.copy()
        step = relative_step * (1.0 + abs(at[place]))
        ahead[place] += step
        behind[place] -= step
        here, there = function(behind), function(ahead)
        # A constraint that does not apply is -inf on both sides: nothing changes.
        applies = ~(np.isneginf(here) & np.isneginf(there))
        with np.errstate(invalid='ignore'):
            change = np.subtract(there, here, out=np.zeros_like(here), where=applies)
            # Not `2 step`: what was added is what counts, after rounding.
            columns.append(change / (ahead[place] - behind[place]))
    return np.stack(columns, axis=-1)
