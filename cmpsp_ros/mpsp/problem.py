"""The optimal control problem (1)-(6), and its derivatives as arrays over the horizon."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import ProblemError, check_bounds, not_finite, numbers

Hessian = Literal['gauss_newton', 'exact', 'projected']
"""Second derivative of the stage costs ``L_k`` that a problem returns, (49)-(52).

``gauss_newton`` leaves out the curvature of the residuals and is positive semi-definite; ``exact``
is the second derivative as it is, indefinite where the cost is not convex; ``projected`` is its
positive semi-definite part. None of them holds the curvature of ``F``, ``h`` or ``g``: neither do
(45) and (49)-(52), and Lemma 1, which calls (45) the Hessian of ``J`` by the controls, is right for
linear dynamics only.
"""


@dataclass(frozen=True)
class Dimensions:
    """Sizes of an optimal control problem.

    Attributes:
        horizon: ``N``, the number of steps; controls are ``U_0 ... U_N``.
        state: ``n``.
        control: ``r``.
        output: ``m``, components of the terminal output; 0 where there is no terminal constraint.
        path: ``l``, path constraints at each stage.
    """

    horizon: int
    state: int
    control: int
    output: int
    path: int

    def __post_init__(self) -> None:
        at_least = {'horizon': 1, 'state': 1, 'control': 1, 'output': 0, 'path': 0}
        for name, least in at_least.items():
            size = getattr(self, name)
            if size < least:
                raise ProblemError(f'{name}: found {size}, wanted at least {least}')


# Of the arrays of a `Linearisation`, with K for N + 1.
_SHAPES = ('Nnn', 'Nnr', 'Kn', 'Kr', 'Knn', 'Krn', 'Krr', 'm', 'mn', 'mr', 'Kl', 'Kln', 'Klr')


@dataclass(frozen=True)
class Linearisation:
    """Everything the method asks of a problem along a predicted trajectory.

    Jacobians have the derivative along columns, the transposes of the paper's. A path constraint
    that does not apply at a stage (every one of the state alone at stage 0, where the state is
    known) has the value ``-inf`` there and takes no row of the quadratic program.

    Attributes:
        A: ``dF_k/dX_k``, shape ``(N, n, n)``.
        B: ``dF_k/dU_k``, shape ``(N, n, r)``.
        L_X: Gradient of the cost by the state (48), shape ``(N + 1, n)``.
        L_U: Gradient of the cost by the control (48), shape ``(N + 1, r)``.
        L_XX: Hessian blocks (49), shape ``(N + 1, n, n)``.
        L_UX: Hessian blocks (51), shape ``(N + 1, r, n)``; (52) is their transpose.
        L_UU: Hessian blocks (50), shape ``(N + 1, r, r)``.
        output_error: ``Y_N - Y_N*`` of (11), shape ``(m,)``.
        h_X: ``dh_N/dX_N``, shape ``(m, n)``.
        h_U: ``dh_N/dU_N``, shape ``(m, r)``.
        g: Path constraints (4), met where not positive, shape ``(N + 1, l)``.
        g_X: ``dg_k/dX_k``, shape ``(N + 1, l, n)``.
        g_U: ``dg_k/dU_k``, shape ``(N + 1, l, r)``.
    """

    A: Array
    B: Array
    L_X: Array
    L_U: Array
    L_XX: Array
    L_UX: Array
    L_UU: Array
    output_error: Array
    h_X: Array
    h_U: Array
    g: Array
    g_X: Array
    g_U: Array

    @property
    def size(self) -> Dimensions:
        """The dimensions that the arrays seem to have."""
        N, n, r = self.B.shape
        return Dimensions(N, n, r, len(self.output_error), self.g.shape[1])

    def check(self, size: Dimensions) -> None:
        """Raise `ProblemError` where an array has the wrong shape or a value that is not finite."""
        self.check_shapes(size)
        if found := self.not_finite:
            raise ProblemError(f'{found}, wanted finite numbers')

    @property
    def not_finite(self) -> str:
        """The first number that is not finite, and where it is; empty where all are.

        Derivatives of a constraint that does not apply may be anything.
        """
        for field in fields(self):
            array = getattr(self, field.name)
            if field.name in {'g', 'g_X', 'g_U'}:
                array = array.copy()
                array[self.g == -np.inf] = 0.0
            at_end = field.name in {'output_error', 'h_X', 'h_U'}
            if found := not_finite(field.name, array, at_end=at_end):
                return found
        return ''

    def check_shapes(self, size: Dimensions) -> None:
        """Raise `ProblemError` where an array has the wrong shape."""
        lengths = {'N': size.horizon, 'K': size.horizon + 1, 'n': size.state, 'r': size.control}
        lengths |= {'m': size.output, 'l': size.path}
        for field, letters in zip(fields(self), _SHAPES, strict=True):
            found, wanted = getattr(self, field.name).shape, tuple(lengths[x] for x in letters)
            if found != wanted:
                raise ProblemError(f'{field.name}: found shape {found}, wanted {wanted}')


@dataclass(frozen=True)
class Evaluation:
    """Cost ``J`` of (3) without proximal terms, ``Y_N - Y_N*`` ``(m,)``, and (4) ``(N + 1, l)``.

    A path constraint that does not apply is ``-inf``.
    """

    cost: float
    output_error: Array
    g: Array


class OptimalControlProblem(ABC):
    """A problem of the form (1)-(6), from one known initial state over one horizon.

    A subclass gives the prediction, the value and the derivatives; all of them over the whole
    horizon at once, so that each can be compiled.

    Attributes:
        size: Dimensions of all arrays.
        control_lower: Least controls, shape ``(N + 1, r)``, ``-inf`` where there is no limit.
        control_upper: Largest controls, shape ``(N + 1, r)``.
        target: ``Y_N*`` of (5), shape ``(m,)``.
    """

    size: Dimensions
    control_lower: Array
    control_upper: Array
    target: Array

    @abstractmethod
    def predict(self, U: Array) -> Array:
        """Roll the dynamics (1) out from (6) along ``U``: ``X_0 ... X_N``, shape ``(N + 1, n)``."""

    @abstractmethod
    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Cost (3), terminal output (5) and path constraints (4) along a trajectory."""

    @abstractmethod
    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives along a trajectory, with the second derivative of the cost that is named.

        All but ``exact`` must leave the condensed Hessian positive semi-definite.
        """

    def next_states(self, X: Array, U: Array) -> Array:  # noqa: ARG002
        """Dynamics (1) of each stage by itself, ``F_k(X_k, U_k)``, shape ``(N, n)``. Optional.

        States ``(N + 1, n)`` need not fit the controls. Multiple shooting needs it.

        Raises:
            ProblemError: This problem does not have it.
        """
        raise ProblemError('next_states: this problem does not provide it')

    def evaluate_with_next(self, X: Array, U: Array) -> tuple[Evaluation, Array]:
        """`evaluate` and `next_states` of the same states, for problems that share their work."""
        return self.evaluate(X, U), self.next_states(X, U)

    def in_units(
        self,
        state: Array,  # noqa: ARG002
        control: Array,  # noqa: ARG002
        output: Array,  # noqa: ARG002
        path: Array,  # noqa: ARG002
        cost: float,  # noqa: ARG002
    ) -> OptimalControlProblem | None:
        """The same problem in other units, as of `Scaling`; None where it cannot do so itself."""
        return None

    def constraint_curvature(
        self,
        X: Array,  # noqa: ARG002
        U: Array,  # noqa: ARG002
        costates: Array,  # noqa: ARG002
        terminal: Array,  # noqa: ARG002
        path: Array,  # noqa: ARG002
    ) -> tuple[Array, Array, Array]:
        """Second derivatives of ``costates' F + terminal' h + path' g`` along a trajectory.

        Terms of the Hessian of the Lagrangian of (62) that (45) leaves out. Optional.
        Multipliers of ``F_k`` are in row ``k`` of `costates`, ``(N, n)``; `terminal` is ``(m,)``
        and `path` ``(N + 1, l)``, 0 where one does not apply. Blocks by ``XX``, ``UX`` and ``UU``
        have shapes ``(N + 1, n, n)``, ``(N + 1, r, n)`` and ``(N + 1, r, r)``.

        Raises:
            ProblemError: This problem does not have it.
        """
        raise ProblemError('constraint_curvature: this problem does not provide it')

    def check(self) -> None:
        """Raise `ProblemError` unless bounds and target fit the dimensions and each other."""
        wanted = (self.size.horizon + 1, self.size.control)
        for name in ('control_lower', 'control_upper'):
            found = getattr(self, name).shape
            if found != wanted:
                raise ProblemError(f'{name}: found shape {found}, wanted {wanted}')
        check_bounds('control_lower', self.control_lower, 'control_upper', self.control_upper)
        if self.target.shape != (self.size.output,):
            raise ProblemError(
                f'target: found shape {self.target.shape}, wanted {(self.size.output,)}'
            )
        if not np.isfinite(self.target).all():
            raise ProblemError(f'target: found {self.target}, wanted finite numbers')

    def checked_controls(self, U: ArrayLike) -> Array:
        """A copy of a control history; `ProblemError` names its shape or the first bad stage."""
        U = numbers('U', U)
        wanted = (self.size.horizon + 1, self.size.control)
        if U.shape != wanted:
            raise ProblemError(f'U: found shape {U.shape}, wanted {wanted}')
        bad = np.flatnonzero(~np.isfinite(U).all(axis=1))
        if len(bad):
            raise ProblemError(f'U: found {U[bad[0]]} at stage {bad[0]}, wanted finite numbers')
        return U


def check_hessian(hessian: str) -> None:
    """Raise `ProblemError` for a kind of Hessian that does not exist."""
    if hessian not in get_args(Hessian):
        raise ProblemError(
            f'hessian: found {hessian!r}, wanted one of {", ".join(get_args(Hessian))}'
        )
