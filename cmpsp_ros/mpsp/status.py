"""How an iteration ended, in words."""

from __future__ import annotations

from enum import Enum


class Status(Enum):
    """End of a C-MPSP run; the value is a sentence for the user."""

    CONVERGED = 'Converged: terminal error and control change are below their tolerances.'
    ITERATION_LIMIT = 'Stopped at the iteration limit before both tolerances were met.'
    INFEASIBLE = 'The linearised constraints contradict each other; slack was needed to the end.'
    STALLED = 'No step along the search direction lowers the merit function any more.'
    QP_FAILED = 'The QP back end found no solution of the subproblem.'
    NOT_FINITE = 'The prediction or its derivatives are not finite numbers.'
