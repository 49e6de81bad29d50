"""Quadratic programs by the name of their solver, each answer checked before it is believed."""

from __future__ import annotations

import warnings
from dataclasses import replace
from functools import cache, partial
from importlib.util import find_spec

from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.qp import riccati_backend
from cmpsp_ros.mpsp.qp.active_set.fill import kkt_residual
from cmpsp_ros.mpsp.qp.dense import clarabel_backend, daqp_backend, hildreth
from cmpsp_ros.mpsp.qp.riccati_backend import no_warm_start, solve, solve_from
from cmpsp_ros.mpsp.qp.solution import TOLERANCE, Backend, Penalties, QPSolution, QPStatus
from cmpsp_ros.mpsp.qp.subproblem import Row, Subproblem

RICCATI_ACTIVE_SET = 'riccati_active_set'
"""The default back end."""

CLARABEL = 'clarabel'
"""The back end that the default one falls back on."""

_RENAMED = {'riccati_interior_point': CLARABEL}

_NATIVE: dict[str, Backend] = {
    RICCATI_ACTIVE_SET: riccati_backend.solve,
    CLARABEL: clarabel_backend.solve,
    'daqp': daqp_backend.solve,
    'hildreth': hildreth.solve,
}


def available() -> tuple[str, ...]:
    """Names of all back ends installed here, the native ones first."""
    native = tuple(_NATIVE)
    if find_spec('qpsolvers') is None:
        return native
    import qpsolvers  # noqa: PLC0415 (slow to import, and most runs need daqp alone)

    return native + tuple(name for name in qpsolvers.available_solvers if name not in native)


@cache
def backend(name: str) -> Backend:
    """The back end of that name.

    A name of an earlier release is accepted with a `FutureWarning` that names the new one.

    Raises:
        ProblemError: No back end of that name is installed; says which are.
    """
    if name in _RENAMED:
        new = _RENAMED[name]
        warnings.warn(f'qp: {name!r} is now {new!r}', FutureWarning, stacklevel=2)
        name = new
    if name in _NATIVE:
        return _NATIVE[name]
    if name not in available():
        raise ProblemError(f'qp: found {name!r}, wanted one of {", ".join(available())}')
    from cmpsp_ros.mpsp.qp.dense import qpsolvers_backend  # noqa: PLC0415 (slow to import)

    return partial(qpsolvers_backend.solve, name)


def solve_qp(subproblem: Subproblem, name: str, penalties: Penalties | None = None) -> QPSolution:
    """Solve a subproblem and check the answer against the optimality conditions.

    Args:
        subproblem: The program.
        name: Back end.
        penalties: Weights of the exact L1 relaxation of (54) and (57); None keeps them hard.

    Returns:
        The solution; its status is `QPStatus.FAILED` where a back end claims one that is not.
    """
    solution = backend(name)(subproblem, penalties)
    if solution.status is QPStatus.SOLVED:
        residual = kkt_residual(subproblem, solution, penalties)
        if not residual <= TOLERANCE:
            return replace(solution, status=QPStatus.FAILED)
    return solution
