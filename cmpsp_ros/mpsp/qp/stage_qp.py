"""The quadratic program of one iteration as arrays over the stages."""

from __future__ import annotations

from typing import NamedTuple

from cmpsp_ros.mpsp.problem import Array


class StageQP(NamedTuple):
    """Quadratic program in ``dU`` with the linearised states ``dX`` kept; ``dX_0 = 0``.

    Minimise the sum over the stages of ``L_X' dX + L_U' dU + 1/2 dX' L_XX dX + dU' L_UX dX +
    1/2 dU' L_UU dU`` along ``dX_(k+1) = A dX_k + B dU_k``, subject to ``h_X dX_N + h_U dU_N +
    output_error = 0``, ``g + g_X dX + g_U dU <= 0``, ``|dX_k| <= trust_radius`` for ``k >= 1``,
    and ``lower <= dU <= upper``. It is the program (45) (54) (57) before the states are
    eliminated.

    Attributes:
        A: Shape ``(N, n, n)``.
        B: Shape ``(N, n, r)``.
        L_X: Shape ``(N + 1, n)``.
        L_U: Shape ``(N + 1, r)``.
        L_XX: Shape ``(N + 1, n, n)``.
        L_UX: Shape ``(N + 1, r, n)``.
        L_UU: Shape ``(N + 1, r, r)``.
        output_error: Shape ``(m,)``.
        h_X: Shape ``(m, n)``.
        h_U: Shape ``(m, r)``.
        g: Shape ``(N + 1, l)``, ``-inf`` where a constraint does not apply.
        g_X: Shape ``(N + 1, l, n)``.
        g_U: Shape ``(N + 1, l, r)``.
        lower: Least control deviations, ``-inf`` where free, shape ``(N + 1, r)``.
        upper: Largest control deviations, ``inf`` where free, shape ``(N + 1, r)``.
        trust_radius: Largest state deviations, ``inf`` where free, shape ``(n,)``.
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
    lower: Array
    upper: Array
    trust_radius: Array


class Multipliers(NamedTuple):
    """Multipliers of all rows, 0 where a row is not active.

    Attributes:
        terminal: ``lambda``, of either sign, shape ``(m,)``.
        path: ``rho``, not negative, shape ``(N + 1, l)``.
        trust: Of the trust region, positive at ``+trust_radius``, shape ``(N + 1, n)``.
        bounds: ``beta``, positive at the upper bound, shape ``(N + 1, r)``.
    """

    terminal: Array
    path: Array
    trust: Array
    bounds: Array
