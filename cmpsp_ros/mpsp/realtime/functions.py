"""What a problem is to compiled code: three functions of its data.

The data are a named tuple of arrays and numbers, its class standing for the problem. The functions
are given for that class by `cmpsp_ros.mpsp.jit.compiled.implements`, with the names and parameters
that they have here. They must be allocation-free.
"""

from __future__ import annotations

from typing import Any

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.riccati.stage_qp import StageQP


def predict(data: Any, U: Array, X: Array) -> None:
    """Roll the dynamics (1) out from the initial state (6).

    Args:
        data: The problem.
        U: Controls, shape ``(N + 1, r)``.
        X: Filled with the states, shape ``(N + 1, n)``.
    """
    raise NotImplementedError


def evaluate(data: Any, X: Array, U: Array, output_error: Array, g: Array) -> float:
    """Cost (3), terminal output (5) and path constraints (4) along a trajectory.

    Args:
        data: The problem.
        X: States, shape ``(N + 1, n)``.
        U: Controls, shape ``(N + 1, r)``.
        output_error: Filled with ``Y_N - Y_N*``, shape ``(m,)``.
        g: Filled with the path constraints, ``-inf`` where one does not apply; ``(N + 1, l)``.

    Returns:
        ``J``.
    """
    raise NotImplementedError


def linearise(data: Any, X: Array, U: Array, qp: StageQP) -> None:
    """Derivatives along a trajectory.

    Args:
        data: The problem.
        X: States, shape ``(N + 1, n)``.
        U: Controls, shape ``(N + 1, r)``.
        qp: Filled, but for the bounds and the trust region. Entries that are 0 at all times are 0
            to begin with and need not be written.
    """
    raise NotImplementedError
