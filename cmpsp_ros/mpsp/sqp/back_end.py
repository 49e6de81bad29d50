"""Subproblems solved by any QP back end, for a driver whose records hold them."""

from __future__ import annotations

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import entry_for
from cmpsp_ros.mpsp.problem import Hessian
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus, solve_qp
from cmpsp_ros.mpsp.qp.active_set.records import Space, put_solution, subproblem_in
from cmpsp_ros.mpsp.qp.active_set.solver import activate, correct
from cmpsp_ros.mpsp.qp.curvature import convexify
from cmpsp_ros.mpsp.qp.dense.closed_form import has_closed_form, solve_closed_form
from cmpsp_ros.mpsp.qp.riccati.program import Outcome
from cmpsp_ros.mpsp.qp.subproblem import Subproblem


class BackEnd:
    """A QP back end, with the program it was asked last, its answer, and the Hessian's shift."""

    subproblem: Subproblem
    solution: QPSolution
    shift: float

    def __init__(self, name: str, hessian: Hessian, space: Space) -> None:
        """Take the back end's name, the kind of Hessian, and the records that hold the program."""
        self._name = name
        self._is_exact = hessian == 'exact'
        self._space = space
        self._activate = entry_for(activate, space.program, space.active)
        self.begin()

    def begin(self) -> None:
        """Expect another program in the records."""
        self.shift = 0.0
        self._is_new, self._is_convex = True, False

    def solve(self, level: int) -> int:
        """Solve the program at a relaxation level, into the records; returns the outcome.

        Where there is no solution, curvature is asked for, once. Looking for it beforehand would
        cost a factorisation in every iteration, and Hessians that are not exact seldom lack it:
        they are positive semi-definite by construction.
        """
        if self._is_new and self._is_exact:
            self.add_curvature()
        if self._is_new:
            self.subproblem = subproblem_in(self._space)
        # Asked again although no curvature was lacking.
        elif level == 0 and not self.shift:
            return Outcome.INFEASIBLE
        self._is_new = False
        self.solution = self._solve_hard() if level == 0 else self._solve_relaxed()
        if self.solution.status is not QPStatus.SOLVED:
            unknown = self.solution.status is QPStatus.FAILED and not self._is_convex
            return Outcome.NO_CURVATURE if unknown else Outcome.INFEASIBLE
        found = self.solution
        put_solution(self._space, found, self.subproblem.propagate(found.dU))
        return Outcome.SOLVED

    def add_curvature(self) -> None:
        """Add to the Hessian in the records what it lacks."""
        self._is_convex = True
        self.shift = convexify(subproblem_in(self._space)).shift
        if self.shift:
            diagonal = range(self._space.size.control)
            self._space.program.stages['L_UU'][:, diagonal, diagonal] += self.shift
            self._is_new = True

    def correct(self, output_error: Array, g: Array) -> None:
        """Second-order correction, into the records, as `solver.correct`; 0 where there is none."""
        program, active = self._space.program, self._space.active
        if self._activate(program, active):
            correct(program, active, output_error, g)
        else:
            program.stages['correction_U'] = 0.0

    def _solve_hard(self) -> QPSolution:
        if has_closed_form(self.subproblem):
            return solve_closed_form(self.subproblem)
        return solve_qp(self.subproblem, self._name)

    def _solve_relaxed(self) -> QPSolution:
        program = self._space.program
        terminal, path = program.terminal['penalty'], program.path['penalty']
        stages = self.subproblem.size.horizon + 1
        penalties = Penalties(terminal.copy(), path[:stages].copy())
        return solve_qp(self.subproblem, self._name, penalties)
