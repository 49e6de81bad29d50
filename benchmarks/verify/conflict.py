"""Whether the rows that a back end names do contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from benchmarks.verify.border import ROUNDING
from benchmarks.verify.case import Program
from benchmarks.verify.clarabel_reference import least_violation
from cmpsp_ros.mpsp.qp import Row
from cmpsp_ros.mpsp.subproblem import Subproblem


def contradict(program: Program, rows: Sequence[Row]) -> bool:
    """Whether the named rows alone have no solution, or the whole program all but has one."""
    violation = least_violation(replace(program, subproblem=_only(program.subproblem, rows)))
    return violation > 0.1 * ROUNDING or least_violation(program) < ROUNDING


def _only(subproblem: Subproblem, rows: Sequence[Row]) -> Subproblem:
    """A subproblem without other rows, but for a trust region, which is of all stages."""
    alone = subproblem.only(rows)
    lin, outputs = alone.linearisation, [row.index for row in rows if row.kind == 'terminal']
    return replace(
        alone,
        linearisation=replace(
            lin,
            output_error=lin.output_error[outputs],
            h_X=lin.h_X[outputs],
            h_U=lin.h_U[outputs],
        ),
    )
