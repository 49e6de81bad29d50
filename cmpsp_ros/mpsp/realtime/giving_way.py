"""Which constraints give way where not all can be met: first the lightest, and they alone.

The weights of the relaxation rank the rows. A sum of weighted slacks would trade a little of one
row for much of another, however far apart the weights are. So what is heavier stays hard as long as
there is a solution without its slack, and only then all rows give way together.
"""

from __future__ import annotations

import math
from typing import Final

from cmpsp_ros.mpsp.compiled import allocation_free
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty

ATTEMPTS: Final = 3
"""Without slack, with slack of the lightest rows, and with slack of all."""


@allocation_free
def let_give_way(weights: Penalty, attempt: int, most: Penalty) -> None:
    """Set the penalties of an attempt.

    Args:
        weights: Those of the relaxation.
        attempt: Which of the `ATTEMPTS` it is, from 0.
        most: Filled, infinite where a row is hard.
    """
    heaviest = -math.inf
    if attempt == 1:
        heaviest = _lightest(weights)
    elif attempt > 1:
        heaviest = math.inf
    for j in range(weights.terminal.shape[0]):
        weight = weights.terminal[j]
        most.terminal[j] = weight if weight <= heaviest else math.inf
    for k in range(weights.path.shape[0]):
        for j in range(weights.path.shape[1]):
            weight = weights.path[k, j]
            most.path[k, j] = weight if weight <= heaviest else math.inf


@allocation_free
def _lightest(weights: Penalty) -> float:
    found = math.inf
    for j in range(weights.terminal.shape[0]):
        found = min(found, weights.terminal[j])
    for j in range(weights.path.shape[1]):
        found = min(found, weights.path[0, j])
    return found
