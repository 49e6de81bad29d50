"""Whether a program is so near the border of feasibility that rounding decides."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.verify.case import Program
from benchmarks.verify.clarabel_reference import least_violation

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
