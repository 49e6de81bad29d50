"""The quadratic program of one iteration, stage by stage; condensed only for who asks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from cmpsp_ros.mpsp.problem import Array, Dimensions, Linearisation
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP, condense
from cmpsp_ros.mpsp.qp.stage_qp import StageQP


class Row(NamedTuple):
    """One constraint of a subproblem.

    Attributes:
        kind: Which constraints it is one of.
        stage: Stage ``k``; ``N`` for a terminal output.
        index: Component of the output, number of the path constraint, or component of the control
            (bound) or of the state (trust region).
    """

    kind: Literal['terminal', 'path', 'bound', 'trust']
    stage: int
    index: int  # type: ignore[assignment]


@dataclass(frozen=True)
class Subproblem:
    """Program (45) (54) (57) of one iterate, with bounds and trust region.

    Everything here takes time and memory in proportion to the horizon, but for `condensed`.

    Attributes:
        linearisation: Derivatives along the predicted trajectory.
        lower: Least control deviations, ``-inf`` where free, shape ``(N + 1, r)``.
        upper: Largest control deviations, ``inf`` where free, shape ``(N + 1, r)``.
        trust_radius: Largest predicted change of each state component at every stage, ``inf``
            where free, shape ``(n,)``.
        shift: Added to the diagonal of every ``L_UU``, which adds as much to that of (45).
    """

    linearisation: Linearisation
    lower: Array
    upper: Array
    trust_radius: Array
    shift: float = 0.0

    @cached_property
    def size(self) -> Dimensions:
        """Dimensions of all arrays."""
        N, n, r = self.linearisation.B.shape
        m, l = len(self.linearisation.output_error), self.linearisation.g.shape[1]  # noqa: E741
        return Dimensions(N, n, r, m, l)

    @cached_property
    def stages(self) -> StageQP:
        """The same program as plain arrays, with the shift in it."""
        shifted = _shifted(self.linearisation, self.shift)
        derivatives = {
            field.name: _plain(getattr(shifted, field.name)) for field in fields(Linearisation)
        }
        return StageQP(
            lower=_plain(self.lower),
            upper=_plain(self.upper),
            trust_radius=_plain(self.trust_radius),
            **derivatives,
        )

    @cached_property
    def condensed(self) -> CondensedQP:
        """The same program in the controls alone, with the shift in it.

        Time and memory grow with the square of the horizon.
        """
        shifted = _shifted(self.linearisation, self.shift)
        return condense(shifted, self.lower, self.upper, self.trust_radius)

    def only(self, rows: Iterable[Row]) -> Subproblem:
        """The same program with no other rows than these and the terminal ones.

        A bound stays on both sides, and a trust region at all stages.
        """
        path, bound = np.zeros(self.linearisation.g.shape, bool), np.zeros(self.lower.shape, bool)
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
            linearisation=replace(
                self.linearisation, g=np.where(path, self.linearisation.g, -np.inf)
            ),
            lower=np.where(bound, self.lower, -np.inf),
            upper=np.where(bound, self.upper, np.inf),
            trust_radius=np.where(trust, self.trust_radius, np.inf),
        )

    def propagate(self, dU: Array) -> Array:
        """Linearised change of the states (7), shape ``(N + 1, n)``.

        Args:
            dU: Control deviations, shape ``(N + 1, r)``.
        """
        lin = self.linearisation
        dX: Array = np.zeros((self.size.horizon + 1, self.size.state))
        moved = np.einsum('kia,ka->ki', lin.B, dU[:-1])
        for k, (A, change) in enumerate(zip(lin.A, moved, strict=True)):
            dX[k + 1] = A @ dX[k] + change
        return dX

    def terminal(self, dU: Array, dX: Array) -> Array:
        """Linearised terminal error, the left-hand side of (54); shape ``(m,)``.

        Args:
            dU: Control deviations, shape ``(N + 1, r)``.
            dX: What `propagate` gives for them.
        """
        lin = self.linearisation
        error: Array = lin.output_error + lin.h_X @ dX[-1] + lin.h_U @ dU[-1]
        return error

    def path(self, dU: Array, dX: Array) -> Array:
        """Linearised path constraints (57), met where not positive; shape ``(N + 1, l)``.

        Args:
            dU: Control deviations, shape ``(N + 1, r)``.
            dX: What `propagate` gives for them.

        Returns:
            Their values, ``-inf`` where one does not apply.
        """
        lin = self.linearisation
        change = np.einsum('kli,ki->kl', lin.g_X, dX) + np.einsum('kla,ka->kl', lin.g_U, dU)
        return np.where(lin.g == -np.inf, -np.inf, lin.g + change)

    def slope(self, dU: Array, dX: Array) -> float:
        """Directional derivative of the cost (48).

        Args:
            dU: Control deviations, shape ``(N + 1, r)``.
            dX: What `propagate` gives for them.
        """
        lin = self.linearisation
        return float(np.vdot(lin.L_X, dX) + np.vdot(lin.L_U, dU))


def _shifted(linearisation: Linearisation, shift: float) -> Linearisation:
    if not shift:
        return linearisation
    L_UU = linearisation.L_UU + shift * np.eye(linearisation.L_UU.shape[1])
    return replace(linearisation, L_UU=L_UU)


def _plain(array: Array) -> Array:
    """An array of the one kind that kernels are compiled for."""
    plain = np.ascontiguousarray(array, dtype=np.float64)
    return plain if plain.flags.writeable else plain.copy()
