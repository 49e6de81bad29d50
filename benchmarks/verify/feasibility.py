"""Whether a program has a feasible point, by how much, and which rows leave it none."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.verify.case import Program
from benchmarks.verify.clarabel_reference import least_violation
from cmpsp_ros.mpsp.qp import Penalties, Row

ROUNDING = 1e-7
"""Change of the limits that is taken for rounding."""

_NOTICED = 0.1


def nearly_feasible(program: Program) -> bool:
    """Whether an infeasible program misses feasibility by rounding alone."""
    return least_violation(program) < ROUNDING


def nearly_infeasible(program: Program) -> bool:
    """Whether limits that are tighter by rounding leave no feasible point."""
    moved = (_tightened(program, side) for side in (1.0, -1.0))
    return any(least_violation(each) > _NOTICED * ROUNDING for each in moved)


def _tightened(program: Program, side: float) -> Program:
    """Every limit moved inwards, and terminal targets to one side and the other by turns."""
    subproblem = program.subproblem
    lin, lower, upper = subproblem.linearisation, subproblem.lower, subproblem.upper
    sides = np.resize([side, -side], len(lin.output_error))
    moved = replace(lin, g=lin.g + ROUNDING, output_error=lin.output_error + ROUNDING * sides)
    room = upper - lower > 2.0 * ROUNDING
    tight = replace(
        subproblem,
        linearisation=moved,
        lower=np.where(room, lower + ROUNDING, lower),
        upper=np.where(room, upper - ROUNDING, upper),
        trust_radius=np.maximum(subproblem.trust_radius - ROUNDING, 0.0),
    )
    return replace(program, subproblem=tight)


def contradict(program: Program, rows: Sequence[Row]) -> bool:
    """Whether the named rows alone have no solution, or the whole program all but has one."""
    alone, outputs = (
        program.subproblem.only(rows),
        [row.index for row in rows if row.kind == 'terminal'],
    )
    lin, weights = alone.linearisation, program.penalties
    left = replace(
        lin, output_error=lin.output_error[outputs], h_X=lin.h_X[outputs], h_U=lin.h_U[outputs]
    )
    if weights is not None:
        weights = Penalties(weights.terminal[outputs], weights.path)
    named = Program(replace(alone, linearisation=left), weights)
    return least_violation(named) > _NOTICED * ROUNDING or nearly_feasible(program)
