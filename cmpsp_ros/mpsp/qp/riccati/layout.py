"""How a program's numbers lie in memory: one record a stage, and one a constraint row.

The sizes ``n`` and ``r`` are part of the records' types. Code compiled for them has constant loop
counts, an argument stands for all the arrays of its record, and what a sweep needs of a stage is
side by side. The horizon and the number of path constraints are lengths of arrays, known at run
time. In Python a field of all records is an ordinary array: ``stages['A']`` has shape
``(N + 1, n, n)``.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

RecordType = np.dtype[Any]


@cache
def stage_type(n: int, r: int) -> RecordType:
    """A stage of the quadratic program (45) (54) (57), of its factorisation and of its solution.

    The program, before the states are eliminated, is to minimise the sum over the stages of
    ``L_X' dX + L_U' dU + 1/2 dX' L_XX dX + dU' L_UX dX + 1/2 dU' L_UU dU`` along
    ``dX_(k+1) = A dX_k + B dU_k`` with ``dX_0 = 0``, subject to its rows (see `row_type`),
    ``lower <= dU <= upper``, and ``|dX_k| <= trust_radius`` for ``k >= 1``.

    Args:
        n: States.
        r: Controls.
    """
    return _record(
        # What one sweep needs is side by side. The program first; `A` and `B` of the last stage are
        # not used.
        A=(n, n),
        B=(n, r),
        L_X=(n,),
        L_U=(r,),
        L_XX=(n, n),
        L_UX=(r, n),
        L_UU=(r, r),
        # Its Riccati factorisation, dU = L_inv' v - K dX.
        optimum=(r,),
        K=(r, n),
        L_inv=(r, r),
        A_cl=(n, n),
        B_cl=(n, r),
        # Its solution, and limits.
        dU=(r,),
        dX=(n,),
        lower=(r,),
        upper=(r,),
        bounds=(r,),
        trust=(n,),
        # Controls that are held at a bound (1 at the upper one, -1 at the lower one) are taken out
        # of the factorisation: they move the states by `drift`, and `origin_U`, `origin_X` is the
        # step at v = 0.
        fixed=(r,),
        drift=(n,),
        origin_U=(r,),
        origin_X=(n,),
        covariance=(n, n),
        # Second-order correction of the step.
        correction_U=(r,),
        correction_X=(n,),
    )


@cache
def row_type(n: int, r: int) -> RecordType:
    """A linearised constraint ``value + X' dX + U' dU``, not positive (path) or 0 (terminal).

    A path constraint that does not apply has the value ``-inf``. `penalty` is the largest
    multiplier in force, infinite where the row is hard; `weight` that of the relaxation, and
    `merit` the weight in the merit function.

    Args:
        n: States.
        r: Controls.
    """
    return _record(value=(), X=(n,), U=(r,), multiplier=(), penalty=(), weight=(), merit=())


@cache
def head_type(n: int, r: int) -> RecordType:
    """What there is once for a whole program: horizon, counters, and the row that is looked at.

    `begun` numbers the stage at which the horizon begins, for warm starts of a later one.

    Args:
        n: States.
        r: Controls.
    """
    whole = [
        (name, np.int64)
        for name in (
            'horizon',
            'begun',
            'iterations',
            'active',
            'saturated',
            'implied',
            'conflicting',
            'fixed',
            'has_covariance',
            'is_factorised',
            'is_proved',
            'work',
            'work_limit',
        )
    ]
    row = _record(trust_radius=(n,), X=(n,), U=(r,))
    return np.dtype([*whole, *row.descr])


def _record(**shapes: tuple[int, ...]) -> RecordType:
    return np.dtype([(name, np.float64, shape) for name, shape in shapes.items()])
