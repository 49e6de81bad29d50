"""The C-MPSP method for any problem of the form (1)-(6): arrays in, arrays out.

Import from here, ``from cmpsp_ros.mpsp import solve``; each name is loaded from its own module on
first use, so that a caller of one part does not wait for the others.
"""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.arguments import ProblemError
    from cmpsp_ros.mpsp.convergence import Convergence
    from cmpsp_ros.mpsp.models.casadi_functions import from_casadi
    from cmpsp_ros.mpsp.models.control_rate import ControlRateProblem
    from cmpsp_ros.mpsp.models.derivatives import DerivativeReport, check_derivatives
    from cmpsp_ros.mpsp.models.functions import from_functions
    from cmpsp_ros.mpsp.options import Options
    from cmpsp_ros.mpsp.problem import (
        Dimensions,
        Evaluation,
        Hessian,
        Linearisation,
        OptimalControlProblem,
    )
    from cmpsp_ros.mpsp.qp.back_ends import available, solve_qp
    from cmpsp_ros.mpsp.qp.curvature import convexify
    from cmpsp_ros.mpsp.qp.dense.closed_form import has_closed_form, solve_closed_form
    from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP, condense, sensitivities
    from cmpsp_ros.mpsp.qp.subproblem import Penalties, QPSolution, QPStatus, Row, Subproblem
    from cmpsp_ros.mpsp.results import (
        SLACK_TOLERANCE,
        Iterate,
        Record,
        Solution,
        Status,
        Step,
        Violation,
    )
    from cmpsp_ros.mpsp.scaling import Scaling
    from cmpsp_ros.mpsp.solution_gradient import Gradient, gradient
    from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP
    from cmpsp_ros.mpsp.sqp.solve import solve

__getattr__, __all__ = lazy_exports(__name__, __file__)
