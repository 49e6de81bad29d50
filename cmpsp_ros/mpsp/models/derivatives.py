"""Derivatives by complex step or by differences, and the check of those that a problem returns."""

import warnings
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import ProblemError
from cmpsp_ros.mpsp.problem import Hessian, Linearisation, OptimalControlProblem, check_hessian

Scheme = Literal['complex_step', 'central']

_COMPLEX_STEP = 1e-30
# Least sum of truncation and rounding: of a first difference, and of a difference of differences.
STEP = float(np.finfo(float).eps ** (1.0 / 3.0))
_TWICE = float(np.finfo(float).eps ** (1.0 / 4.0))
_AGREEMENT = 1e-5


class StageFunction:
    """A user's function ``(k, x, u)`` as one of ``k`` and ``Z_k = (X_k, U_k)``.

    `name` is the user's argument, `shape` that of the value, `scheme` the kind of differentiation.
    """

    scheme: Scheme = 'central'

    def __init__(
        self, name: str, function: Callable[..., Any], states: int, shape: tuple[int, ...]
    ) -> None:
        """Take the function, the number of states in ``Z_k``, and the shape of the value."""
        self.name = name
        self.shape = shape
        self.function = function
        self._states = states

    def __call__(self, k: int, Z: NDArray[Any]) -> NDArray[Any]:
        """The value: NaN where Python's arithmetic overflows, complex where ``Z`` is.

        Raises:
            ProblemError: The value has the wrong shape or is no number.
        """
        try:
            with np.errstate(all='ignore'):
                # Copies: the function may work in place.
                found = self.function(k, Z[: self._states].copy(), Z[self._states :].copy())
        except OverflowError:
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
    """Derivatives by components of `at`, all or those at `places`, along a last axis.

    Steps are relative to 1 plus the size of the component.
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
            # Not `2 step`: the difference counts as rounded.
            columns.append(change / (ahead[place] - behind[place]))
    return np.stack(columns, axis=-1)


_ROUNDING = 8.0 * float(np.finfo(float).eps)
# Directions of the state that controls reach by less than this, next to the one they reach most,
# cannot be distinguished from rounding.
_REACHED = 1e-4


@dataclass(frozen=True)
class Entry:
    """One derivative of an array of `Linearisation`, found and by central differences.

    `error` is ``|found - by_differences|`` beyond the rounding of the differences, relative to ``1
    + |by_differences|``; infinite where either is not finite. Gradients have no `row`.
    """

    array: str
    stage: int
    row: int | None
    column: int
    found: float
    by_differences: float
    error: float

    def __str__(self) -> str:
        where = '' if self.row is None else f'row {self.row}, '
        return (
            f'{self.array} at stage {self.stage}, {where}column {self.column}: '
            f'found {self.found:.9g}, by differences {self.by_differences:.9g}'
        )


@dataclass(frozen=True)
class DerivativeReport:
    """The entry with the largest error of each array, worst first, and the tolerance."""

    tolerance: float
    worst: tuple[Entry, ...]

    @property
    def is_right(self) -> bool:
        """True where no entry's error exceeds the tolerance."""
        return self.worst[0].error <= self.tolerance

    def __str__(self) -> str:
        verdict = 'Derivatives agree with' if self.is_right else 'Derivatives differ from'
        return f'{verdict} differences (worst: {self.worst[0]}; error {self.worst[0].error:.2g}).'


def check_derivatives(
    problem: OptimalControlProblem,
    U: Array,
    tolerance: float = 1e-5,
    hessian: Hessian | None = 'exact',
    proximal: float = 0.0,
) -> DerivativeReport:
    """Compare all arrays of `linearise` with central differences, at one control history.

    ``L_X``, ``L_U``, ``h_X``, ``h_U``, ``g_X`` and ``g_U`` are compared with differences of
    `evaluate`, ``B`` with differences of `predict`. ``A`` is checked by these, too: it must carry
    the sensitivities (23) of one stage to the next, ``A_k dX_k/dU = dX_(k+1)/dU``. So only its
    action on reachable states is checked, all that the method uses; nothing of ``A_0``. Second
    derivatives of the cost are compared with differences of the gradients ``L_X`` and ``L_U``.

    Args:
        problem: The problem.
        U: Where, shape ``(N + 1, r)``; best a history without symmetries or zeros.
        tolerance: Largest relative error that passes.
        hessian: Kind whose second derivatives are compared: ``exact``, or another kind for a
            problem on which it is exact, too; None compares none.
        proximal: Term added by intent to the diagonal of ``L_UU``.

    Returns:
        Verdict and worst entries.

    Raises:
        ProblemError: ``U``, an array of the linearisation or an argument has the wrong shape or
            value.
    """
    U = problem.checked_controls(U)
    if hessian is not None:
        check_hessian(hessian)
    if not tolerance > 0.0:
        raise ProblemError(f'tolerance: found {tolerance}, wanted a positive number')
    X = problem.predict(U)
    lin = problem.linearise(X, U, hessian or 'gauss_newton')
    lin.check_shapes(problem.size)
    pairs = [*_of_predict(problem, U, lin), *_of_evaluate(problem, X, U, lin)]
    if hessian is not None:
        pairs += _of_gradients(problem, X, U, hessian, proximal)
    entries = [
        _worst(name, getattr(lin, name), expected, noise, problem.size.horizon)
        for name, expected, noise in pairs
        if expected.size
    ]
    return DerivativeReport(tolerance, tuple(sorted(entries, key=lambda entry: -entry.error)))


_Pair = tuple[str, Array, float]


def _of_predict(problem: OptimalControlProblem, U: Array, lin: Linearisation) -> Iterator[_Pair]:
    N, n, r = lin.B.shape
    # dX_k/dU_j, shape (N + 1, n, N + 1, r).
    places = [(j, b) for j in range(N) for b in range(r)]
    reach = central_differences(problem.predict, U, places=places).reshape(N + 1, n, N, r)
    noise = _noise(problem.predict(U))
    stages = np.arange(N)
    yield 'B', reach[stages + 1, :, stages], noise
    A = lin.A.copy()
    for k in range(1, N):
        before, after = (reach[stage, :, :k].reshape(n, k * r) for stage in (k, k + 1))
        if np.isfinite(A[k]).all() and np.isfinite(before).all() and np.isfinite(after).all():
            # The least correction of A_k that explains the differences.
            A[k] += (after - A[k] @ before) @ np.linalg.pinv(before, rcond=_REACHED)
    yield 'A', A, noise


def _of_evaluate(
    problem: OptimalControlProblem, X: Array, U: Array, lin: Linearisation
) -> Iterator[_Pair]:
    N, n, r = lin.B.shape
    applies = lin.g != -np.inf

    def values(Z: Array) -> Array:
        at = problem.evaluate(Z[:, :n], Z[:, n:])
        return np.concatenate([[at.cost], at.output_error, np.where(applies, at.g, 0.0).ravel()])

    Z = np.hstack([X, U])
    found, noise = central_differences(values, Z), _noise(values(Z))
    m, path = problem.size.output, problem.size.path
    L_Z = found[0].reshape(N + 1, n + r)
    h_Z = found[1 : 1 + m].reshape(m, N + 1, n + r)[:, N]
    g_Z = found[1 + m :].reshape(N + 1, path, N + 1, n + r)[range(N + 1), :, range(N + 1)]
    # Rows that do not apply are not used.
    g_Z = np.where(applies[:, :, None], g_Z, np.concatenate([lin.g_X, lin.g_U], axis=2))
    for name, Z_part in (('L', L_Z), ('h', h_Z), ('g', g_Z)):
        yield f'{name}_X', Z_part[..., :n], noise
        yield f'{name}_U', Z_part[..., n:], noise


def _of_gradients(
    problem: OptimalControlProblem, X: Array, U: Array, hessian: Hessian, proximal: float
) -> Iterator[_Pair]:
    n, r = X.shape[1], U.shape[1]
    second = np.empty((len(X), n + r, n + r))
    noise = 0.0
    Z = np.hstack([X, U])
    for i in range(n + r):
        # A gradient depends on its own stage alone: all stages are moved at once.
        ahead, behind, steps = Z.copy(), Z.copy(), STEP * (1.0 + np.abs(Z[:, i]))
        ahead[:, i] += steps
        behind[:, i] -= steps
        there, here = (
            np.hstack([at.L_X, at.L_U])
            for at in (problem.linearise(z[:, :n], z[:, n:], hessian) for z in (ahead, behind))
        )
        with np.errstate(invalid='ignore'):
            second[:, :, i] = (there - here) / (ahead - behind)[:, i, None]
        noise = max(noise, _noise(there))
    yield 'L_XX', second[:, :n, :n], noise
    yield 'L_UX', second[:, n:, :n], noise
    yield 'L_UU', second[:, n:, n:] + proximal * np.eye(r), noise


def _noise(values: Array) -> float:
    """Rounding of differences of such values."""
    return _ROUNDING / STEP * float(np.abs(values[np.isfinite(values)]).max(initial=0.0))


def _worst(name: str, found: Array, expected: Array, noise: float, horizon: int) -> Entry:
    with np.errstate(invalid='ignore'):
        beyond = np.maximum(np.abs(found - expected) - noise, 0.0)
        error = beyond / (1.0 + np.abs(expected))
    error = np.where(np.isfinite(error), error, np.inf)
    place = np.unravel_index(int(error.argmax()), error.shape)
    index = [int(part) for part in place]
    # h_X and h_U are the last stage's; gradients have no rows.
    stage = horizon if name in {'h_X', 'h_U'} else index.pop(0)
    row = index.pop(0) if len(index) == 2 else None
    values = float(found[place]), float(expected[place])
    return Entry(name, stage, row, index[0], *values, float(error[place]))
