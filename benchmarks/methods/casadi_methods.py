"""Solvers that CasADi brings along, on the very same problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np

from benchmarks.errors import BenchError
from benchmarks.families.task import Task
from benchmarks.methods.method import ITERATIONS
from benchmarks.methods.nlp import STAGE, STATES, Program, pack, program, unpack
from cmpsp_ros.arrays import Array


class _CasadiSolver:
    """A solver of nonlinear programs, made once for each horizon."""

    def __init__(self, task: Task, name: str, largest: int, failure: str) -> None:
        self.name, self.largest = name, largest
        self._task, self._failure = task, failure
        self._solvers: dict[int, Any] = {}

    def prepare(self, steps: int) -> None:
        """Have the solver for a horizon made."""
        if steps not in self._solvers:
            self._solvers[steps] = self._made(program(self._task, steps))

    def begin(self, steps: int) -> None:
        """Each call starts from the controls alone."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Solve the problem that is left, from the path rolled out.

        Raises:
            BenchError: The solver fails.
        """
        return unpack(self._answer(pose, U, durations)['x'].full().ravel(), U[-1])

    def _answer(self, pose: Array, U: Array, durations: Array, **more: Array) -> Any:
        steps = len(durations)
        limits = program(self._task, steps).limits
        w, p = pack(self._task, pose, U, durations)
        try:
            return self._solvers[steps](x0=w, p=p, **limits, **more)
        except RuntimeError as error:
            raise BenchError(self._failure) from error

    def _made(self, made: Program) -> Any:
        raise NotImplementedError


class Sqp(_CasadiSolver):
    """Two full steps of CasADi's `sqpmethod`, its quadratic programs solved by a plug-in.

    The Hessian is the method's own, Gauss-Newton and the weight of the proximal term. That term's
    gradient is left out, since the method measures it from each iterate anew, where it is 0. States
    are kept, and gaps close by the linearisation alone: from the second iteration on it is another
    path to the same end.
    """

    def __init__(
        self, task: Task, plugin: str, options: Mapping[str, Any], largest: int,
        iterations: int = ITERATIONS,
    ) -> None:  # fmt: skip
        """Take the task and say which plug-in."""
        failure = f'{plugin} does not solve one of its programs'
        super().__init__(task, f'sqpmethod + {plugin}', largest, failure)
        self._options: dict[str, Any] = {
            'qpsol': plugin,
            'qpsol_options': dict(options),
            'min_iter': iterations,
            'max_iter': iterations,
            'max_iter_ls': 0,
            'print_header': False,
            'print_iteration': False,
            'print_status': False,
            'print_time': False,
        }

    def qp_time(self, steps: int) -> float:
        """What the quadratic programs of the last step of so many took, as CasADi says [us]."""
        return float(self._solvers[steps].stats()['t_proc_QP']) * 1e6

    def _made(self, made: Program) -> Any:
        multipliers = casadi.SX.sym('lam_f'), casadi.SX.sym('lam_g', made.g.shape[0])
        hessian = casadi.Function(
            'hessian',
            [made.w, made.p, *multipliers],
            [made.hessian],
            ['x', 'p', 'lam_f', 'lam_g'],
            ['hess_gamma_x_x'],
        )
        nlp = {'x': made.w, 'p': made.p, 'f': made.cost, 'g': made.g}
        options = {**self._options, 'hess_lag': hessian}
        return casadi.nlpsol('solver', 'sqpmethod', nlp, options)


class Converged(_CasadiSolver):
    """A solver for nonlinear programs, run until it has converged.

    The proximal term is measured from the warm start: without it the speeds along the road would
    be free, and the program be harder for the solver than what it is compared with.
    """

    def __init__(
        self, task: Task, solver: str, options: Mapping[str, Any], *, keeps_multipliers: bool
    ) -> None:
        """Take the task and say which solver.

        Args:
            task: The task.
            solver: Name of an NLP solver of CasADi's.
            options: For it.
            keeps_multipliers: Whether it can start from the last step's multipliers.
        """
        failure = f'{solver} cannot work with its program'
        super().__init__(task, f'{solver}, to convergence', 400, failure)
        self._solver = solver
        self._options: dict[str, Any] = {'print_time': False, solver: dict(options)}
        self._keeps_multipliers = keeps_multipliers
        self._multipliers: dict[str, Array] = {}

    def begin(self, steps: int) -> None:  # noqa: ARG002 (each call is of a size of its own)
        """Forget the multipliers."""
        self._multipliers = {}

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Solve the problem that is left, from the path rolled out.

        Raises:
            BenchError: The solver does not even begin.
        """
        answer = self._answer(pose, U, durations, **self._multipliers)
        if self._keeps_multipliers and len(durations) > 1:
            self._multipliers = self._later(answer)
        return unpack(answer['x'].full().ravel(), U[-1])

    def _made(self, made: Program) -> Any:
        options = self._options
        if self._solver == 'fatrop':
            options = {**options, 'structure_detection': 'auto', 'equality': made.equality}
        nlp = {'x': made.w, 'p': made.p, 'f': made.cost + made.proximal, 'g': made.g}
        return casadi.nlpsol('solver', self._solver, nlp, options)

    def _later(self, answer: Any) -> dict[str, Array]:
        """Multipliers for a horizon that begins one stage later."""
        bounds, rows = (answer[name].full().ravel() for name in ('lam_x', 'lam_g'))
        gap = rows[2 * STATES : 3 * STATES]
        # What the next stage had of constraints of its own, it has to be where the robot is now.
        rest = rows[3 * STATES + 1 + len(self._task.space.centers) :]
        return {'lam_x0': bounds[STAGE:], 'lam_g0': np.concatenate([gap, np.zeros(STATES), rest])}
