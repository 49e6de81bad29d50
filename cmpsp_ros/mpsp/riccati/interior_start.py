"""Where the interior point begins."""

from __future__ import annotations

import math
from typing import Any

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.riccati.barrier import EQUAL, HARD, OFF, RELAXED, advance, place_row
from cmpsp_ros.mpsp.riccati.interior_room import InteriorPoint
from cmpsp_ros.mpsp.riccati.rows import BOUND, TRUST, limit_of, place_of, value_of, white_length
from cmpsp_ros.mpsp.riccati.stage_qp import Penalty, StageQP
from cmpsp_ros.mpsp.riccati.whitening import spread, unwhiten

# Limits that are no farther apart, relative to 1 plus their size, leave nothing between them.
_APART = 1e-10
# Least distance and product at the start.
_LEAST = 1e-10
# Price of a hard row in the second attempt, relative to the distances of the program.
_PRICE = 1e8


@allocation_free
def begin(qp: StageQP, penalty: Penalty, room: InteriorPoint, priced: bool) -> Any:
    """Slacks and multipliers on the scale of the minimum without any row.

    Returns:
        What `advance` does.
    """
    b, white = room.barrier, room.white
    room.U[:] = 0.0
    room.X[:] = 0.0
    gain = 0.0
    for i in range(white.optimum.shape[0]):
        gain += white.optimum[i] ** 2
    spread(qp, white)
    unwhiten(qp, white, white.optimum, room.step_U, room.step_X)
    far, pairs = 0.0, 0
    for row in range(b.kind.shape[0]):
        bound, cap = limit_of(qp, penalty, row)
        b.kind[row] = _kind_of(qp, row, bound, cap)
        if b.kind[row] == OFF:
            b.length[row] = b.offset[row] = b.multiplier[row] = 0.0
            continue
        length = white_length(qp, white, row)
        b.length[row] = length if length > 0.0 else 1.0
        b.value[row] = -bound
        violation = value_of(qp, row, room.step_U, room.step_X) - bound
        if b.kind[row] == EQUAL or row < qp.output_error.shape[0]:
            violation, bound = abs(violation), -abs(bound)
        far = max(far, violation / b.length[row], -bound / b.length[row])
        pairs += 2
    distance = math.sqrt(gain + far * far)
    product = max(10.0 * distance * distance, _LEAST) / max(pairs, 1)
    least = max(0.1 * far, 1e-3 * distance, _LEAST)
    for row in range(b.kind.shape[0]):
        if b.kind[row] == OFF:
            continue
        cap = limit_of(qp, penalty, row)[1]
        terminal = row < qp.output_error.shape[0]
        # Bounds alone never contradict each other here, and are the better kept the closer.
        hard = b.kind[row] == HARD and place_of(qp, row).kind != BOUND
        if priced and cap == math.inf and (terminal or hard):
            b.kind[row] = RELAXED
            cap = _PRICE * distance / b.length[row]
        b.offset[row] = 0.0
        if terminal and b.kind[row] == RELAXED:
            b.offset[row] = cap
            cap *= 2.0
        place_row(b, row, max(-b.value[row], least * b.length[row]), cap, product)
    return advance(b, 0.0)


@allocation_free
def _kind_of(qp: StageQP, row: int, bound: float, cap: float) -> int:
    """What a row is in the barrier."""
    if not abs(bound) < math.inf or cap <= 0.0:
        return OFF
    if row < qp.output_error.shape[0]:
        return EQUAL if cap == math.inf else RELAXED
    place = place_of(qp, row)
    if place.kind == TRUST and place.stage == 0:
        return OFF
    kind = HARD if cap == math.inf else RELAXED
    lower, upper = -math.inf, math.inf
    if place.kind == BOUND:
        lower, upper = (
            qp.lower[place.stage, place.component],
            qp.upper[place.stage, place.component],
        )
    elif place.kind == TRUST:
        lower, upper = -bound, bound
    if upper < math.inf and is_nothing(lower, upper):
        kind = EQUAL if place.sign > 0.0 else OFF
    return kind


@allocation_free
def is_nothing(lower: float, upper: float) -> bool:
    """Whether there is nothing between two limits."""
    return abs(upper - lower) <= _APART * (1.0 + min(abs(lower), abs(upper)))
