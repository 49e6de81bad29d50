"""Whether the rows that a back end names do contradict each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cmpsp_ros.mpsp.qp import Row
from cmpsp_ros.mpsp.subproblem import Subproblem
from cmpsp_ros.studies.verify.border import ROUNDING
from cmpsp_ros.studies.verify.case import Program
from cmpsp_ros.studies.verify.clarabel_reference import least_violation


def contradict(program: Program, rows: Sequence[Row]) -> bool:
    """Whether the named rows alone have no solution, or the whole program all but has one."""
    violation = least_violation(replace(program, subproblem=_only(program.subproblem, rows)))
    return violation > 0.1 * ROUNDING or least_violation(program) < ROUNDING


def _only(subproblem: Subproblem, rows: Sequence[Row]) -> Subproblem:
    """A subproblem without other rows, but for a trust region, which is of all stages."""
    lin = subproblem.linearisation
    outputs = [row.index for row in rows if row.kind == 'terminal']
    path, bound = np.zeros(lin.g.shape, dtype=bool), np.zeros(lin.L_U.shape, dtype=bool)
    trust = np.zeros(subproblem.trust_radius.shape, dtype=bool)
    for row in rows:
        if row.kind == 'path':
            path[row.stage, row.index] = True
        elif row.kind == 'bound':
            bound[row.stage, row.index] = True
        elif row.kind == 'trust':
            trust[row.index] = True
    return replace(
        subproblem,
        linearisation=replace(
            lin,
            output_error=lin.output_error[outputs],
            h_X=lin.h_X[outputs],
            h_U=lin.h_U[outputs],
            g=np.where(path, lin.g, -np.inf),
        ),
        lower=np.where(bound, subproblem.lower, -np.inf),
        upper=np.where(bound, subproblem.upper, np.inf),
        trust_radius=np.where(trust, subproblem.trust_radius, np.inf),
    )
