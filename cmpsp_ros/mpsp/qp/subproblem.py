"""The quadratic program of one iteration, stage by stage, and its solution."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.problem import Dimensions, Linearisation
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP, condense


class Row(NamedTuple):
    """One constraint of a subproblem.

    `stage` is ``N`` for a terminal output; `index` is the component of the output, the number of
    the path constraint, or the component of the control (bound) or of the state (trust region).
    """

    kind: Literal['terminal', 'path', 'bound', 'trust']
    stage: int
    index: int  # type: ignore[assignment]


@dataclass(frozen=True)
class Subproblem:
    """Program (45) (54) (57) of one iterate in ``dU``, with the linearised states ``dX`` kept.

    Minimise the sum over the stages of ``L_X' dX + L_U' dU + 1/2 dX' L_XX dX + dU' L_UX dX +
    1/2 dU' L_UU dU`` along ``dX_(k+1) = A dX_k + B dU_k``, ``dX_0 = 0``, subject to ``h_X dX_N +
    h_U dU_N + output_error = 0``, ``g + g_X dX + g_U dU <= 0``, ``|dX_k| <= trust_radius`` for
    ``k >= 1``, and ``lower <= dU <= upper``.

    Attributes:
        linearisation: Derivatives along the predicted trajectory.
        lower: Least control deviations, ``-inf`` where free, shape ``(N + 1, r)``.
        upper: Largest control deviations, ``inf`` where free, shape ``(N + 1, r)``.
        trust_radius: Largest predicted change of each state component at every stage, ``inf``
            where free, shape ``(n,)``.
        shift: Term that `convexify` has added to the diagonal of every ``L_UU``.
    """

    linearisation: Linearisation
    lower: Array
    upper: Array
    trust_radius: Array
    shift: float = 0.0

    @cached_property
    def size(self) -> Dimensions:
        """Dimensions of all arrays."""
        return self.linearisation.size

    @cached_property
    def condensed(self) -> CondensedQP:
        """The same program in the controls alone; takes time and memory ``O(N^2)``."""
        return condense(self.linearisation, self.lower, self.upper, self.trust_radius)

    def only(self, rows: Iterable[Row]) -> Subproblem:
        """The same program with these rows and the terminal ones alone.

        A bound stays on both sides, and a trust region at all stages.
        """
        lin = self.linearisation
        path, bound = np.zeros(lin.g.shape, bool), np.zeros(self.lower.shape, bool)
        trust = np.zeros(self.trust_radius.shape, bool)
        for row in rows:
            if row.kind == 'path':
                path[row.stage, row.index] = True
            elif row.kind == 'bound':
                bound[row.stage, row.index] = True
            elif row.kind == 'trust':
                trust[row.index] = True
        return replace(
            self,
            linearisation=replace(lin, g=np.where(path, lin.g, -np.inf)),
            lower=np.where(bound, self.lower, -np.inf),
            upper=np.where(bound, self.upper, np.inf),
            trust_radius=np.where(trust, self.trust_radius, np.inf),
        )

    def propagate(self, dU: Array) -> Array:
        """Linearised change of the states (7), shape ``(N + 1, n)``."""
        lin = self.linearisation
        dX: Array = np.zeros((self.size.horizon + 1, self.size.state))
        moved = np.einsum('kia,ka->ki', lin.B, dU[:-1])
        for k, (A, change) in enumerate(zip(lin.A, moved, strict=True)):
            dX[k + 1] = A @ dX[k] + change
        return dX

    def terminal(self, dU: Array, dX: Array) -> Array:
        """Linearised terminal error, the left-hand side of (54), shape ``(m,)``."""
        lin = self.linearisation
        error: Array = lin.output_error + lin.h_X @ dX[-1] + lin.h_U @ dU[-1]
        return error

    def path(self, dU: Array, dX: Array) -> Array:
        """Linearised path constraints (57), ``-inf`` where one does not apply; ``(N + 1, l)``."""
        lin = self.linearisation
        change = np.einsum('kli,ki->kl', lin.g_X, dX) + np.einsum('kla,ka->kl', lin.g_U, dU)
        return np.where(lin.g == -np.inf, -np.inf, lin.g + change)


# Relative violation of the optimality conditions up to which an answer is a solution.
TOLERANCE = 1e-5


class QPStatus(Enum):
    """End of a quadratic program; the value is a sentence for the user."""

    SOLVED = 'The quadratic program was solved.'
    INFEASIBLE = 'No control satisfies all linearised constraints.'
    FAILED = 'The QP back end gave up or returned a point that is not a solution.'


@dataclass(frozen=True)
class Penalties:
    """Weights of the exact L1 relaxation: cost of violating each row by one unit.

    Of terminal outputs ``(m,)``, and of path constraints ``(N + 1, l)``, of no effect where one
    does not apply.
    """

    terminal: Array
    path: Array


@dataclass(frozen=True)
class QPSolution:
    """Solution of a subproblem; where not solved, the arrays hold zeros.

    Attributes:
        status: How it ended.
        dU: Control deviations, shape ``(N + 1, r)``.
        terminal: Multipliers ``lambda`` of (54), of either sign, shape ``(m,)``.
        path: Multipliers ``rho`` of (57), not negative, 0 where a constraint does not apply,
            shape ``(N + 1, l)``.
        trust: Multipliers of the trust region, positive at ``+trust_radius``, shape
            ``(N + 1, n)``.
        bounds: Multipliers ``beta`` of the control bounds, positive at the upper one, shape
            ``(N + 1, r)``.
        iterations: Iterations of the back end, 0 where unknown.
        conflict: Constraints that contradict each other, as far as the back end names them.
    """

    status: QPStatus
    dU: Array
    terminal: Array
    path: Array
    trust: Array
    bounds: Array
    iterations: int = 0
    conflict: tuple[Row, ...] = ()

    @classmethod
    def unsolved(
        cls, size: Dimensions, status: QPStatus, conflict: tuple[Row, ...] = ()
    ) -> QPSolution:
        """The answer of a back end that has none."""
        stages = size.horizon + 1
        return cls(
            status,
            np.zeros((stages, size.control)),
            np.zeros(size.output),
            np.zeros((stages, size.path)),
            np.zeros((stages, size.state)),
            np.zeros((stages, size.control)),
            conflict=conflict,
        )


# Solves with hard rows, or with (54) and (57) relaxed where penalties are given.
Backend = Callable[[Subproblem, Penalties | None], QPSolution]
