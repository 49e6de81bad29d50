"""Which constraints give way where not all can be met: the lightest first, and they alone.

The weights of the relaxation rank the rows. A sum of weighted slacks would trade a little of one
row for much of another, however far apart the weights are. So what is heavier stays hard as long as
there is a solution without its slack: the next lightest rows give way only where the lightest are
not enough, and the others only where both are not.
"""

from __future__ import annotations

import math
from typing import Final

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty

RANKS: Final = 3
"""Attempts with slack: of the lightest rows, of the next lightest as well, and of all."""


@allocation_free
def let_give_way(weights: Penalty, attempt: int, most: Penalty) -> bool:
    """Set the penalties of an attempt.

    Args:
        weights: Those of the relaxation.
        attempt: Which it is: 0 without slack, then those of `RANKS`.
        most: Filled, infinite where a row is hard.

    Returns:
        Whether any row is hard.
    """
    heaviest = -math.inf
    for _ in range(attempt):
        heaviest = _next(weights, heaviest)
    if attempt >= RANKS:
        heaviest = math.inf
    hard = False
    for j in range(weights.terminal.shape[0]):
        weight = weights.terminal[j]
        most.terminal[j] = weight if weight <= heaviest else math.inf
        hard = hard or weight > heaviest
    for k in range(weights.path.shape[0]):
        for j in range(weights.path.shape[1]):
            weight = weights.path[k, j]
            most.path[k, j] = weight if weight <= heaviest else math.inf
            hard = hard or weight > heaviest
    return hard


@allocation_free
def _next(weights: Penalty, lighter: float) -> float:
    """The least weight above another."""
    found = math.inf
    for j in range(weights.terminal.shape[0]):
        if weights.terminal[j] > lighter:
            found = min(found, weights.terminal[j])
    for j in range(weights.path.shape[1]):
        if weights.path[0, j] > lighter:
            found = min(found, weights.path[0, j])
    return found
