"""Whether the rows that a back end names do contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from benchmarks.verify.border import ROUNDING
from benchmarks.verify.case import Program
from benchmarks.verify.clarabel_reference import least_violation
from cmpsp_ros.mpsp.qp import Penalties, Row


def contradict(program: Program, rows: Sequence[Row]) -> bool:
    """Whether the named rows alone have no solution, or the whole program all but has one."""
    violation = least_violation(_only(program, rows))
    return violation > 0.1 * ROUNDING or least_violation(program) < ROUNDING


def _only(program: Program, rows: Sequence[Row]) -> Program:
    """A program without other rows, but for a trust region, which is of all stages."""
    alone = program.subproblem.only(rows)
    lin, outputs = alone.linearisation, [row.index for row in rows if row.kind == 'terminal']
    left = replace(
        lin,
        output_error=lin.output_error[outputs],
        h_X=lin.h_X[outputs],
        h_U=lin.h_U[outputs],
    )
    weights = program.penalties
    if weights is not None:
        weights = Penalties(weights.terminal[outputs], weights.path)
    return Program(replace(alone, linearisation=left), weights)
