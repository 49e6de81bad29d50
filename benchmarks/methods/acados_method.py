"""acados on the very same problem: its generated C code through its own Python interface."""

from __future__ import annotations

import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any

import casadi
import numpy as np
from acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver

from benchmarks.common import BenchError
from benchmarks.methods.casadi_methods import CONTROLS, STATES, clear, distance
from benchmarks.methods.ours import ITERATIONS
from benchmarks.task import Task
from cmpsp_ros.arrays import Array
from cmpsp_ros.studies.paper import motion

_FREE = 1e6
"""What acados takes for no bound."""


class Acados:
    """Real-time iterations of acados, two a control step.

    The Hessian is given: Gauss-Newton and the weight of the proximal term, whose gradient is 0 at
    every iterate, as with `Sqp`. All horizons share one set of generated code. Timed are two
    solutions and the transfer of arrays, all stages at once.
    """

    largest = 400

    def __init__(self, task: Task, qp_solver: str) -> None:
        """Take the task and acados' name of a QP solver."""
        self.name = f'acados, {qp_solver.lower().replace("_", " ")}'
        self._task = task
        self._qp_solver = qp_solver
        # Held for as long as the code in it is loaded.
        self._folder = tempfile.TemporaryDirectory(prefix='acados_')
        self._solvers: dict[int, Any] = {}
        self._durations: dict[int, Array] = {}

    def prepare(self, steps: int) -> None:
        """Generate and compile code for the first horizon; later ones are made from the same."""
        if steps in self._solvers:
            return
        folder, first = Path(self._folder.name), not self._solvers
        try:
            with (folder / 'log').open('a') as log, chdir(folder), redirect_stdout(log):
                solver = AcadosOcpSolver(
                    self._ocp(steps), 'ocp.json', generate=first, build=first, verbose=False
                )
                solver.set_new_time_steps(np.ones(steps))
        except Exception as error:  # it raises bare ones
            raise BenchError(str(error)) from error
        self._solvers[steps] = solver

    def begin(self, steps: int) -> None:
        """Each step starts from the controls alone; multipliers are made anew by each QP."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Two real-time iterations from the path rolled out."""
        steps = len(durations)
        solver = self._solvers[steps]
        # Usually they equal those of the previous run.
        if not np.array_equal(self._durations.get(steps, ()), durations):
            solver.set_flat('p', np.append(durations, durations[-1]))
            self._durations[steps] = durations
        X = self._task.settings.robot.roll_out(pose, U, durations)
        solver.set(0, 'lbx', pose)
        solver.set(0, 'ubx', pose)
        solver.set_flat('x', X.ravel())
        solver.set_flat('u', U[:-1].ravel())
        for _ in range(ITERATIONS):
            solver.solve()
        controls: Array = solver.get_flat('u').reshape(-1, CONTROLS)
        return np.vstack([controls, U[-1]])

    def _ocp(self, steps: int) -> Any:
        ocp, task = AcadosOcp(), self._task
        ocp.model = self._model()
        lower, upper = (np.clip(row, -_FREE, _FREE) for row in clear(task, ocp.model.x)[1:])
        limit = np.full(CONTROLS, task.settings.robot.max_wheel_speed)
        goal = np.array(task.settings.goal)
        ocp.cost.cost_type = ocp.cost.cost_type_e = 'EXTERNAL'
        constraints = ocp.constraints
        constraints.x0 = task.pose
        constraints.lbu, constraints.ubu, constraints.idxbu = -limit, limit, np.arange(CONTROLS)
        constraints.lh, constraints.uh = lower, upper
        constraints.lh_e, constraints.uh_e = lower, upper
        constraints.lbx_e, constraints.ubx_e, constraints.idxbx_e = goal, goal, np.arange(len(goal))
        ocp.parameter_values = task.durations(steps)[:1]
        options = ocp.solver_options
        # To acados every step is of length 1, or it would weigh the cost by the length.
        options.N_horizon, options.tf = steps, float(steps)
        options.integrator_type = 'DISCRETE'
        options.nlp_solver_type = 'SQP_RTI'
        options.hessian_approx = 'GAUSS_NEWTON'
        options.qp_solver = self._qp_solver
        return ocp

    def _model(self) -> Any:
        task, road = self._task, self._task.settings.world.annulus
        x, u = casadi.SX.sym('x', STATES), casadi.SX.sym('u', CONTROLS)
        duration = casadi.SX.sym('duration')
        model = AcadosModel()
        model.name = f'cmpsp_{self._qp_solver.lower()}'
        model.x, model.u, model.p = x, u, duration
        model.disc_dyn_expr = x + motion(casadi, task.settings.robot, x[2], u, duration)
        off_center = distance(x, road.center) - road.center_radius
        slope = casadi.jacobian(off_center, x)
        across = task.settings.weights.road_center * casadi.mtimes(slope.T, slope)
        cost = task.settings.weights.road_center / 2.0 * off_center**2
        model.cost_expr_ext_cost = model.cost_expr_ext_cost_e = cost
        change = task.settings.weights.control_change * casadi.SX.eye(CONTROLS)
        # Controls first is acados' order.
        model.cost_expr_ext_cost_custom_hess = casadi.diagcat(change, across)
        model.cost_expr_ext_cost_custom_hess_e = across
        model.con_h_expr = model.con_h_expr_e = clear(task, x)[0]
        return model
