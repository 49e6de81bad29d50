"""A QP back end at work in a driver's records."""

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import entry_for
from cmpsp_ros.mpsp.problem import Hessian
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPSolution, QPStatus, solve_qp
from cmpsp_ros.mpsp.qp.active_set.records import Space, program_in, put_solution, subproblem_in
from cmpsp_ros.mpsp.qp.active_set.solver import activate, correct
from cmpsp_ros.mpsp.qp.active_set.state import WarmStart
from cmpsp_ros.mpsp.qp.back_ends import answer_in
from cmpsp_ros.mpsp.qp.curvature import convexify
from cmpsp_ros.mpsp.qp.dense.clarabel_backend import load_proof
from cmpsp_ros.mpsp.qp.dense.closed_form import has_closed_form, solve_closed_form
from cmpsp_ros.mpsp.qp.riccati.program import Outcome


class BackEnd:
    """A QP back end, with its last answer and the Hessian's shift."""

    solution: QPSolution
    shift: float

    def __init__(
        self, name: str, hessian: Hessian, space: Space, warm: tuple[WarmStart, ...] = ()
    ) -> None:
        """Take its name, the kind of Hessian, the records, and warm starts without and with slack.

        With warm starts the default back end works in the records themselves.
        """
        self._name, self._space = name, space
        self._is_exact = hessian == 'exact'
        self._warm = warm if name == RICCATI_ACTIVE_SET else ()
        if not warm:
            # Seldom needed, and never to be waited for.
            load_proof(space.size)
            entry_for(activate, space.program, space.active)
        self.begin()

    def begin(self) -> None:
        """Expect another program in the records."""
        self.shift = 0.0
        self._is_new, self._is_convex, self._has_basis = True, False, False

    def solve(self, level: int) -> int:
        """Solve the program at a relaxation level, into the records; returns the outcome.

        Where there is no solution, curvature is asked for, once; to look for it beforehand would
        cost a factorisation, and Hessians that are not exact seldom lack it.
        """
        if self._is_new and self._is_exact:
            self.add_curvature()
        # Asked again although no curvature was lacking.
        elif not self._is_new and level == 0 and not self.shift:
            return Outcome.INFEASIBLE
        self._is_new, is_relaxed, outcome = False, bool(level > 0), None
        if self._warm:
            space, warm = self._space, self._warm[is_relaxed]
            outcome = space.solve(warm)
            self.solution = answer_in(space, outcome, warm, lambda: program_in(space))
            if outcome is Outcome.SOLVED:
                self._has_basis = True
                return outcome
        subproblem, penalties = program_in(self._space)
        if outcome in {None, Outcome.NO_CURVATURE}:
            if not is_relaxed and has_closed_form(subproblem):
                self.solution = solve_closed_form(subproblem)
            elif outcome is None:
                self.solution = solve_qp(subproblem, self._name, penalties)
        found = self.solution
        if found.status is QPStatus.SOLVED:
            put_solution(self._space, found, subproblem.propagate(found.dU))
            return Outcome.SOLVED
        unknown = found.status is QPStatus.FAILED and not self._is_convex
        return Outcome.NO_CURVATURE if unknown else Outcome.INFEASIBLE

    def add_curvature(self) -> None:
        """Convexify the Hessian in the records."""
        self._is_convex = True
        self.shift = convexify(subproblem_in(self._space)).shift
        if self.shift:
            diagonal = range(self._space.size.control)
            self._space.program.stages['L_UU'][:, diagonal, diagonal] += self.shift
            self._is_new = True

    def correct(self, output_error: Array, g: Array) -> None:
        """Second-order correction, into the records, as `solver.correct`; 0 where there is none."""
        program, active = self._space.program, self._space.active
        if self._has_basis or activate(program, active):
            correct(program, active, output_error, g)
        else:
            program.stages['correction_U'] = 0.0
