"""Proof by multipliers that no point meets the hard rows of a program (Farkas' lemma).

Rows are added up with multipliers, of any sign for equalities and not negative otherwise, and the
states eliminated by an adjoint sweep: every feasible point meets the sum, ``constant + slope' dU
<= 0``. If its minimum within the bounds of the controls is positive, there is none. Such
a proof rests on the data of the program alone, wherever its multipliers come from: those of the
last program, a stage later, mostly prove the same of the next one at once.
"""

import math
from typing import Final

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.qp.active_set.fixed_bounds import recover_bound_multipliers
from cmpsp_ros.mpsp.qp.active_set.state import ActiveSet, WarmStart
from cmpsp_ros.mpsp.qp.riccati.program import (
    Program,
    RowKind,
    clear_multipliers,
    is_bound,
    limit,
    locate,
    multiplier_of,
    row_number,
    set_multiplier,
)

# A proof covers all controls within their bounds, and within this where they have none.
FARTHEST: Final = 1e6

# A contradiction up to this, relative to the size of the terms, may be rounding.
_ROUNDING = 1e-8
# Slopes up to this fraction of the largest are met by `FARTHEST`, if that leaves a proof.
_THRESHOLDS = (1e-12, 0.0)


@allocation_free
def contradicts(p: Program, at: ActiveSet, largest: float) -> bool:
    """True where the multipliers of the rows prove that nothing meets them; names them.

    `largest` is the largest multiplier of a bound.
    """
    for threshold in _THRESHOLDS:  # noqa: SIM110 (numba knows no generators here)
        if proves(p, at, threshold * largest):
            return True
    return False


@allocation_free
def proves(p: Program, at: ActiveSet, negligible: float) -> bool:
    """As `contradicts`, without the bounds whose multiplier is not above `negligible`."""
    if not _least_value(p, negligible) > 0.0:
        return False
    name_rows(p, at, negligible)
    return True


@inner
def _least_value(p: Program, negligible: float) -> float:
    """Least value of the sum of the rows within the bounds, less its rounding."""
    head, total, size = p.head[0], 0.0, 0.0
    for j in range(p.terminal.shape[0]):
        row = p.terminal[j]
        total += row.multiplier * row.value
        size += abs(row.multiplier) * (1.0 + abs(row.value))
    for k in range(head.horizon + 1):
        stage = p.stages[k]
        for j in range(p.path.shape[1]):
            row = p.path[k, j]
            if row.multiplier != 0.0:
                total += row.multiplier * row.value
                size += row.multiplier * (1.0 + abs(row.value))
        for i in range(stage.trust.shape[0]):
            if stage.trust[i] != 0.0:
                total -= abs(stage.trust[i]) * head.trust_radius[i]
                size += abs(stage.trust[i]) * (1.0 + head.trust_radius[i])
        for a in range(stage.bounds.shape[0]):
            multiplier = stage.bounds[a]
            if multiplier != 0.0:
                bound = stage.upper[a] if multiplier > 0.0 else -stage.lower[a]
                if abs(multiplier) <= negligible or bound == math.inf:
                    bound = FARTHEST
                total -= abs(multiplier) * bound
                size += abs(multiplier * bound)
    return total - _ROUNDING * size


@allocation_free
def name_rows(p: Program, at: ActiveSet, negligible: float) -> None:
    """Name the rows that have a multiplier, bounds if it is not negligible."""
    found = 0
    for row in range(at.states.shape[0]):
        if abs(multiplier_of(p, row)) > (negligible if is_bound(p, row) else 0.0):
            at.conflict[found] = row
            found += 1
    p.head[0].conflicting = found


@allocation_free
def bounds_cross(p: Program, at: ActiveSet, row: int) -> bool:
    """True for a bound of a control whose bounds leave nothing between them; names both."""
    if not is_bound(p, row):
        return False
    _, k, a, _ = locate(p, row)
    lower, upper = p.stages[k].lower[a], p.stages[k].upper[a]
    if not lower - upper > _ROUNDING * (1.0 + abs(upper)):
        return False
    for i in range(2):
        at.conflict[i] = row_number(p, RowKind.BOUND, k, a, 1.0 - 2.0 * i)
    p.head[0].conflicting = 2
    return True


@allocation_free
def leave_proof(p: Program, at: ActiveSet, warm: WarmStart) -> None:
    """Leave the multipliers of a proof in a warm start, if there is room for them."""
    head, found, largest = warm.head[0], 0, 0.0
    for i in range(p.head[0].conflicting):
        if not is_bound(p, at.conflict[i]):
            largest = max(largest, abs(multiplier_of(p, at.conflict[i])))
            found += 1
    head.proof = 0
    if found > warm.proof.shape[0] or not 0.0 < largest < math.inf:
        return
    for i in range(p.head[0].conflicting):
        row = at.conflict[i]
        if not is_bound(p, row):
            place = warm.proof[head.proof]
            place.row, place.multiplier = row, multiplier_of(p, row) / largest
            head.proof += 1


@allocation_free
def still_contradicts(p: Program, at: ActiveSet, warm: WarmStart) -> bool:
    """True where the proof in a warm start, on the present horizon, holds for this program."""
    head = warm.head[0]
    if head.rows == 0:
        head.proof = 0
    if head.proof == 0:
        return False
    clear_multipliers(p)
    for i in range(head.proof):
        row = warm.proof[i].row
        if not 0 <= row < at.states.shape[0]:
            return False
        bound, upper = limit(p, row)
        if upper < math.inf or abs(bound) == math.inf:
            return False
        set_multiplier(p, row, warm.proof[i].multiplier)
    p.head[0].is_proved = int(contradicts(p, at, recover_bound_multipliers(p, 0.0)))
    if p.head[0].is_proved == 0:
        head.proof = 0
    return bool(p.head[0].is_proved == 1)
