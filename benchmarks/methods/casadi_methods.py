"""Solvers that CasADi brings along, on the very same problem with its states kept."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi
import numpy as np

from benchmarks.common import BenchError
from benchmarks.methods.ours import ITERATIONS
from benchmarks.task import Task
from cmpsp_ros.arrays import Array
from cmpsp_ros.studies.paper import motion

STATES, CONTROLS = 3, 2
STAGE = STATES + CONTROLS  # length of one stage in the vector of variables


@dataclass(frozen=True)
class Program:
    """Minimise ``f(w; p)`` within bounds on ``w`` and ``g(w; p)``, stage by stage.

    ``w`` holds the pose and the wheel speeds of each stage and then the last pose; ``g`` the gap
    that closes to the next stage and then the stage's own constraints: at first that the pose is
    the given one, later distances from the road's centre and from the obstacles, at last the
    goal. ``p`` holds the first pose, the lengths of the steps and the wheel speeds ``U_prev``.
    """

    w: Any  # variables, ``5 N + 3`` of them
    p: Any  # parameters
    cost: Any  # first term of (95)
    proximal: Any  # second term of (95), on the change from ``U_prev``
    g: Any  # constraints
    hessian: Any  # Gauss-Newton Hessian of both terms, which is that of `mpsp`
    limits: dict[str, Array]  # the four vectors of bounds, by the names that CasADi has for them
    equality: list[bool]  # true for each constraint that is an equation


@cache
def program(task: Task, steps: int) -> Program:
    """The task from any pose, over that many steps of any length."""
    road, goal = task.settings.world.annulus, np.array(task.settings.goal)
    X = [casadi.SX.sym(f'X_{k}', STATES) for k in range(steps + 1)]
    U = [casadi.SX.sym(f'U_{k}', CONTROLS) for k in range(steps)]
    pose, durations = casadi.SX.sym('pose', STATES), casadi.SX.sym('durations', steps)
    previous = casadi.SX.sym('U_prev', CONTROLS * steps)
    w = casadi.vertcat(*(each for pair in zip(X, U, strict=False) for each in pair), X[-1])

    rows: list[tuple[Any, Array, Array]] = []
    for k, x in enumerate(X):
        if k < steps:
            gap = X[k + 1] - x - motion(casadi, task.settings.robot, x[2], U[k], durations[k])
            rows.append((gap, np.zeros(STATES), np.zeros(STATES)))
        rows.append((x - pose, np.zeros(STATES), np.zeros(STATES)) if k == 0 else clear(task, x))
    rows.append((X[-1][:2], goal, goal))
    lower, upper = (np.concatenate([row[place] for row in rows]) for place in (1, 2))

    off_center = casadi.vertcat(*(distance(x, road.center) - road.center_radius for x in X))
    slope = casadi.jacobian(off_center, w)
    weight, change = task.settings.weights.road_center, task.settings.weights.control_change
    proximal = change / 2.0 * casadi.sumsqr(casadi.vertcat(*U) - previous)
    return Program(
        w=w,
        p=casadi.vertcat(pose, durations, previous),
        cost=weight / 2.0 * casadi.sumsqr(off_center),
        proximal=proximal,
        g=casadi.vertcat(*(row[0] for row in rows)),
        hessian=weight * casadi.mtimes(slope.T, slope) + casadi.hessian(proximal, w)[0],
        limits={**_bounds(task, steps), 'lbg': lower, 'ubg': upper},
        equality=(lower == upper).tolist(),
    )


def pack(task: Task, pose: Array, U: Array, durations: Array) -> tuple[Array, Array]:
    """Variables ``w`` and parameters ``p`` at a warm start, its path rolled out.

    Args:
        task: The task.
        pose: First pose, shape ``(3,)`` [m, m, rad].
        U: Shape ``(N + 1, 2)`` [rad/s].
        durations: Shape ``(N,)`` [s].
    """
    steps = len(durations)
    X = task.settings.robot.roll_out(pose, U, durations)
    w = np.concatenate([np.hstack([X[:-1], U[:-1]]).ravel(), X[-1]])
    return w, np.concatenate([pose, durations, U[:steps].ravel()])


def unpack(w: Array, last: Array) -> Array:
    """Controls ``(N + 1, 2)`` of the variables and the last pair, which is not among them."""
    return np.vstack([w[:-STATES].reshape(-1, STAGE)[:, STATES:], last])


def clear(task: Task, x: Any) -> tuple[Any, Array, Array]:
    """Distances of a pose from road centre and obstacles, with their bounds."""
    space = task.space
    road = space.annulus
    centers = np.vstack([road.center, space.centers]).tolist()
    distances = casadi.vertcat(*(distance(x, center) for center in centers))
    lower = np.concatenate([road.inner, space.radii])
    upper = np.concatenate([road.outer, np.full(len(space.radii), np.inf)])
    return distances, lower, upper


def distance(x: Any, center: Any) -> Any:
    """Distance of a pose from a point, as an expression [m]."""
    return casadi.sqrt((x[0] - center[0]) ** 2 + (x[1] - center[1]) ** 2)


def _bounds(task: Task, steps: int) -> dict[str, Array]:
    limit = task.settings.robot.max_wheel_speed
    stage = np.array([np.inf] * STATES + [limit] * CONTROLS)
    upper = np.append(np.tile(stage, steps), np.full(STATES, np.inf))
    return {'lbx': -upper, 'ubx': upper}


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
        """Solve the problem that is left, from the path rolled out."""
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
        """Time of the quadratic programs in the last step of that horizon, by CasADi [us]."""
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
    be free, and the program harder to solve than those of the other methods.
    """

    def __init__(
        self, task: Task, solver: str, options: Mapping[str, Any], *, keeps_multipliers: bool
    ) -> None:
        """Take the task and say which solver."""
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
        """Solve the problem that is left, from the path rolled out."""
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
        # The constraints of the next stage give way to the fixed initial pose.
        rest = rows[3 * STATES + 1 + len(self._task.space.centers) :]
        return {'lam_x0': bounds[STAGE:], 'lam_g0': np.concatenate([gap, np.zeros(STATES), rest])}
