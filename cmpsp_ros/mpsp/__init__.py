"""The C-MPSP method for any problem of the form (1)-(6): arrays in, arrays out.

What a user needs is imported from here, ``from cmpsp_ros.mpsp import solve``; each name comes from
its own module when first asked for, so that a caller of one part does not wait for the others.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.analysis.convergence import Convergence
    from cmpsp_ros.mpsp.errors import ProblemError
    from cmpsp_ros.mpsp.iterate import Iterate, Record, Step
    from cmpsp_ros.mpsp.models.casadi_functions import from_casadi
    from cmpsp_ros.mpsp.models.control_rate import ControlRateProblem
    from cmpsp_ros.mpsp.models.derivative_check import DerivativeReport, check_derivatives
    from cmpsp_ros.mpsp.models.functions import from_functions
    from cmpsp_ros.mpsp.options import Options
    from cmpsp_ros.mpsp.problem import (
        Dimensions,
        Evaluation,
        Hessian,
        Linearisation,
        OptimalControlProblem,
    )
    from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus, Row, available, solve_qp
    from cmpsp_ros.mpsp.qp.curvature import convexify
    from cmpsp_ros.mpsp.qp.dense.closed_form import has_closed_form, solve_closed_form
    from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP, condense, sensitivities
    from cmpsp_ros.mpsp.qp.subproblem import Subproblem
    from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP, solve
    from cmpsp_ros.mpsp.status import Solution, Status, Violation

__all__ = [
    'CMPSP', 'CondensedQP', 'ControlRateProblem', 'Convergence', 'DerivativeReport', 'Dimensions',
    'Evaluation', 'Hessian', 'Iterate', 'Linearisation', 'OptimalControlProblem', 'Options',
    'Penalties', 'ProblemError', 'QPSolution', 'QPStatus', 'Record', 'Row', 'Solution', 'Status',
    'Step', 'Subproblem', 'Violation', 'available', 'check_derivatives', 'condense', 'convexify',
    'from_casadi', 'from_functions', 'has_closed_form', 'sensitivities', 'solve',
    'solve_closed_form', 'solve_qp',
]  # fmt: skip

_HOMES = {
    'models.casadi_functions': ('from_casadi',),
    'qp.dense.closed_form': ('has_closed_form', 'solve_closed_form'),
    'qp.dense.condensing': ('CondensedQP', 'condense', 'sensitivities'),
    'models.control_rate': ('ControlRateProblem',),
    'analysis.convergence': ('Convergence',),
    'qp.curvature': ('convexify',),
    'models.derivative_check': ('DerivativeReport', 'check_derivatives'),
    'errors': ('ProblemError',),
    'models.functions': ('from_functions',),
    'options': ('Options',),
    'problem': ('Dimensions', 'Evaluation', 'Hessian', 'Linearisation', 'OptimalControlProblem'),
    'qp': ('Penalties', 'QPSolution', 'QPStatus', 'Row', 'available', 'solve_qp'),
    'sqp.cmpsp': ('CMPSP', 'solve'),
    'iterate': ('Iterate', 'Record', 'Step'),
    'status': ('Solution', 'Status', 'Violation'),
    'qp.subproblem': ('Subproblem',),
}
_HOME = {name: module for module, names in _HOMES.items() for name in names}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_HOME[name]}'), name)
