"""Elastic mode: which constraints may be violated where not all can be met.

The weights of the relaxation rank the rows. A sum of weighted slacks would trade a little of one
row for much of another, however far apart the weights are. So what is heavier stays hard as long as
there is a solution without its slack: the next lightest rows are relaxed only where the lightest
are not enough, and the others only where both are not.
"""

from __future__ import annotations

import math
from typing import Final

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.riccati.program import Program

LEVELS: Final = 3
"""Relaxation levels: slack in the lightest rows, in the next lightest as well, and in all."""


@allocation_free
def relax(p: Program, level: int) -> bool:
    """Set the penalties of a relaxation level.

    Args:
        p: The program; the penalty of a row is infinite where it stays hard.
        level: 0 without slack, then those of `LEVELS`.

    Returns:
        Whether any row is hard.
    """
    heaviest = -math.inf
    for _ in range(level):
        heaviest = _next_weight(p, heaviest)
    if level >= LEVELS:
        heaviest = math.inf
    is_hard = False
    for j in range(p.terminal.shape[0]):
        row = p.terminal[j]
        row.penalty = row.weight if row.weight <= heaviest else math.inf
        is_hard = is_hard or row.weight > heaviest
    for k in range(p.head[0].horizon + 1):
        for j in range(p.path.shape[1]):
            row = p.path[k, j]
            row.penalty = row.weight if row.weight <= heaviest else math.inf
            is_hard = is_hard or row.weight > heaviest
    return is_hard


@inner
def _next_weight(p: Program, lighter: float) -> float:
    """The least weight above another."""
    found = math.inf
    for j in range(p.terminal.shape[0]):
        if p.terminal[j].weight > lighter:
            found = min(found, p.terminal[j].weight)
    for j in range(p.path.shape[1]):
        if p.path[0, j].weight > lighter:
            found = min(found, p.path[0, j].weight)
    return found
