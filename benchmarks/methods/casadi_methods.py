"""Solvers that CasADi brings along, on the very same problem."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np
from numpy.typing import NDArray

from benchmarks.errors import BenchError
from benchmarks.families.task import Task
from benchmarks.methods.method import ITERATIONS
from benchmarks.methods.nlp import STAGE, STATES, pack, program, unpack

Array = NDArray[np.float64]


class Sqp:
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
        """Take the task and say which plug-in.

        Args:
            task: The task.
            plugin: Name of a QP solver of CasADi's.
            options: For it.
            largest: Longest horizon.
            iterations: Iterations of a step.
        """
        self.name = f'sqpmethod + {plugin}'
        self.largest = largest
        self._task = task
        self._plugin = plugin
        self._options: dict[str, Any] = dict(options)
        self._iterations = iterations
        self._solvers: dict[int, Any] = {}

    def prepare(self, steps: int) -> None:
        """Have the solver for a horizon made."""
        if steps in self._solvers:
            return
        made = program(self._task, steps)
        multipliers = casadi.SX.sym('lam_f'), casadi.SX.sym('lam_g', made.g.shape[0])
        hessian = casadi.Function(
            'hessian',
            [made.w, made.p, *multipliers],
            [made.hessian],
            ['x', 'p', 'lam_f', 'lam_g'],
            ['hess_gamma_x_x'],
        )
        options: dict[str, Any] = {
            'qpsol': self._plugin,
            'qpsol_options': self._options,
            'hess_lag': hessian,
            'min_iter': self._iterations,
            'max_iter': self._iterations,
            'max_iter_ls': 0,
            'print_header': False,
            'print_iteration': False,
            'print_status': False,
            'print_time': False,
        }
        nlp = {'x': made.w, 'p': made.p, 'f': made.cost, 'g': made.g}
        self._solvers[steps] = casadi.nlpsol('solver', 'sqpmethod', nlp, options)

    def begin(self, steps: int) -> None:
        """Each call starts from the controls alone."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Two iterations from the path rolled out.

        Raises:
            BenchError: A quadratic program was not solved.
        """
        steps = len(durations)
        limits = program(self._task, steps).limits
        w, p = pack(self._task, pose, U, durations)
        try:
            answer = self._solvers[steps](x0=w, p=p, **limits)
        except RuntimeError as error:
            raise BenchError(f'{self._plugin} does not solve one of its programs') from error
        return unpack(answer['x'].full().ravel(), U[-1])

    def qp_time(self, steps: int) -> float:
        """What the quadratic programs of the last step of so many took, as CasADi says [us]."""
        return float(self._solvers[steps].stats()['t_proc_QP']) * 1e6


class Converged:
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
        self.name = f'{solver}, to convergence'
        self.largest = 400
        self._task = task
        self._solver = solver
        self._options: dict[str, Any] = {'print_time': False, solver: dict(options)}
        self._keeps_multipliers = keeps_multipliers
        self._solvers: dict[int, Any] = {}
        self._multipliers: dict[str, Array] = {}

    def prepare(self, steps: int) -> None:
        """Have the solver for a horizon made."""
        if steps in self._solvers:
            return
        made = program(self._task, steps)
        options: dict[str, Any] = dict(self._options)
        if self._solver == 'fatrop':
            options |= {'structure_detection': 'auto', 'equality': made.equality}
        nlp = {'x': made.w, 'p': made.p, 'f': made.cost + made.proximal, 'g': made.g}
        self._solvers[steps] = casadi.nlpsol('solver', self._solver, nlp, options)

    def begin(self, steps: int) -> None:  # noqa: ARG002 (each call is of a size of its own)
        """Forget the multipliers."""
        self._multipliers = {}

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Solve the problem that is left.

        Raises:
            BenchError: The solver does not even begin.
        """
        steps = len(durations)
        limits = program(self._task, steps).limits
        w, p = pack(self._task, pose, U, durations)
        try:
            answer = self._solvers[steps](x0=w, p=p, **limits, **self._multipliers)
        except RuntimeError as error:
            raise BenchError(f'{self._solver} cannot work with its program') from error
        if self._keeps_multipliers and steps > 1:
            self._multipliers = self._later(answer)
        return unpack(answer['x'].full().ravel(), U[-1])

    def _later(self, answer: Any) -> dict[str, Array]:
        """Multipliers for a horizon that begins one stage later."""
        bounds, rows = (answer[name].full().ravel() for name in ('lam_x', 'lam_g'))
        gap = rows[2 * STATES : 3 * STATES]
        # What the next stage had of constraints of its own, it has to be where the robot is now.
        rest = rows[3 * STATES + 1 + len(self._task.space.centers) :]
        return {
            'lam_x0': bounds[STAGE:],
            'lam_g0': np.concatenate([gap, np.zeros(STATES), rest]),
        }
