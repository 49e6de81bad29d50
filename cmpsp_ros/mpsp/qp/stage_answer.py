"""What compiled solvers leave in their rooms, as answers."""

from __future__ import annotations

from collections.abc import Iterable

from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.qp.solution import QPSolution, QPStatus, Row
from cmpsp_ros.mpsp.riccati.rows import BOUND, PATH, place_of
from cmpsp_ros.mpsp.riccati.stage_qp import Multipliers, StageQP


def solved(dU: Array, multipliers: Multipliers, iterations: int) -> QPSolution:
    """A solution with arrays of its own."""
    return QPSolution(
        QPStatus.SOLVED,
        dU.copy(),
        multipliers.terminal.copy(),
        multipliers.path.copy(),
        multipliers.trust.copy(),
        multipliers.bounds.copy(),
        iterations,
    )


def named(qp: StageQP, numbers: Iterable[int]) -> tuple[Row, ...]:
    """Rows by their numbers, in the order of these."""
    return tuple(_row(qp, number) for number in sorted(numbers))


def _row(qp: StageQP, number: int) -> Row:
    if number < len(qp.output_error):
        return Row('terminal', len(qp.A), number)
    place = place_of(qp, number)
    if place.kind == PATH:
        return Row('path', place.stage, place.component)
    return Row('bound' if place.kind == BOUND else 'trust', place.stage, place.component)
