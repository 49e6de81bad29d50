"""The paper's iteration without the guidance law: closed loops, convergence, Theorem 2.

The method and the model are those of the guidance law, but nothing of the law itself is used: no
new plan beside a defective one, no audit, no fallback levels.
"""

from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, remaining, shift, to_nanoseconds
from cmpsp_ros.guidance.formulation import (
    N_EDGE_CONSTRAINTS,
    PENALTIES,
    GuidanceProblem,
    sample_space,
)
from cmpsp_ros.guidance.planning import initial_guess
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.mpsp import Evaluation, Hessian, Linearisation, Options
from cmpsp_ros.mpsp.qp.dense import CondensedQP, condense
from cmpsp_ros.mpsp.sqp import CMPSP
from cmpsp_ros.robots import Robot
from cmpsp_ros.studies.paper.drives import Path
from cmpsp_ros.studies.paper.experiments import Experiment
from cmpsp_ros.world import FreeSpace

# Below this distance from the fixed point [rad/s] rounding decides, and ratios mean nothing.
_FLOOR = 1e-8

# Relative tolerances of Sec. 4 so small that only an iteration at rest ends by itself.
_AT_REST = 1e-14

# A constraint this near to its bound [m] counts as active, a wheel this near to its limit [rad/s].
_ACTIVE = 1e-6
_DIFFERENCE = 1e-3


class Recipe(Enum):
    """Computation of the two iterations of a control step."""

    AS_WRITTEN = 'as written'  # squared constraints (92) (93), hard, and the full step (43)
    # The law's relaxation, trust region and line search, but the warm start alone.
    ONE_PLAN = 'one plan'


def follow(experiment: Experiment, recipe: Recipe, *, between_samples: bool = False) -> Path:
    """Drive a run of the paper by one of the recipes, two iterations a control step."""
    settings = experiment.with_bound(between_samples)
    pose = np.array(experiment.pose)
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    horizon = remaining(0, period, final)
    start = PlanStart(pose, settings.robot, settings.world)
    plan = initial_guess(settings, start, settings.target, horizon.durations)
    driven = []
    for now in range(0, final, period):
        later = remaining(now, period, final)
        plan = _improve(settings, recipe, pose, shift(plan, horizon, later), later.durations)
        horizon = later
        driven.append(plan[0])
        pose = settings.robot.roll_out(pose, plan[:1], later.durations[:1])[-1]
    return Path.open_loop(settings, np.array(experiment.pose), np.array(driven))


class SquaredConstraints(GuidanceProblem):
    """The same problem with the squared distances of (92) and (93)."""

    def __init__(self, robot: Robot, space: FreeSpace, *rest: Any) -> None:
        super().__init__(robot, space, *rest)
        edges = space.annulus
        self._centers = np.vstack([edges.center, edges.center, space.centers])
        self._radii = np.concatenate([edges.outer, edges.inner, space.radii])

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Value, miss and violations [m^2]."""
        evaluation = super().evaluate(X, U)
        return replace(evaluation, g=evaluation.g * (self._distance(X) + self._radii))

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives, by the product rule from those of the distances."""
        linear = super().linearise(X, U, hessian)
        distance = self._distance(X)
        g, g_X = linear.g * (distance + self._radii), linear.g_X * (2.0 * distance[:, :, None])
        return replace(linear, g=g, g_X=g_X)

    def _distance(self, X: Array) -> Array:
        return np.asarray(np.linalg.norm(X[:, None, :2] - self._centers, axis=2))


@dataclass(frozen=True)
class Convergence:
    """Iterations from one guess."""

    first_miss: float  # ``|dY_N|`` of the guess itself [m]
    last_miss: float  # the same after all iterations [m]
    controls: Array  # control history of every iteration, stacked, shape ``(I + 1, q)`` [rad/s]

    @property
    def errors(self) -> Array:
        """``|U^i - U*|`` with the last iterate for ``U*``, down to rounding [rad/s]."""
        errors: Array = np.linalg.norm(self.controls - self.controls[-1], axis=1)
        above = np.flatnonzero(errors > _FLOOR)
        return errors[: above[-1] + 1] if len(above) else errors[:1]

    @property
    def changes(self) -> Array:
        """``|U^(i+1) - U^i|``, shape ``(I,)`` [rad/s]."""
        return np.asarray(np.linalg.norm(np.diff(self.controls, axis=0), axis=1))

    @property
    def ratios(self) -> Array:
        """``|U^(i+1) - U*| / |U^i - U*|`` of (60)."""
        errors = self.errors
        return errors[1:] / errors[:-1]

    @property
    def drift(self) -> float:
        """Cosine of the angle between the last two changes: 1 for a straight line."""
        before, last = np.diff(self.controls[-3:], axis=0)
        return float(before @ last / (np.linalg.norm(before) * np.linalg.norm(last)))

    @property
    def converged(self) -> bool:
        """True if the terminal constraint is met and the controls have come to rest."""
        return self.last_miss < 1e-9 and bool(self.changes[-1] < _FLOOR)


def converge(
    experiment: Experiment,
    guess: tuple[float, float],
    iterations: int,
    *,
    road_center: float,
    full_steps: bool = False,
) -> Convergence:
    """Iterate the problem without road and obstacles from a constant guess [rad/s].

    `road_center` is ``q`` of (95). With `full_steps` each step is taken in full, as (43) is
    written, instead of within the law's trust region and as far as its line search allows.
    """
    settings = experiment.settings
    steps = round(settings.final_time / settings.control_period)
    problem = GuidanceProblem(
        settings.robot,
        FreeSpace.of(settings.road, (), -np.inf),
        replace(settings.weights, road_center=road_center, control_effort=0.0),
        np.array(experiment.pose),
        np.array(settings.goal),
        np.full(steps, settings.control_period),
    )
    options = replace(
        _options(settings, np.full(2, 1e3), np.full(N_EDGE_CONSTRAINTS, 1e3), not full_steps),
        output_tolerance=_AT_REST,
        control_tolerance=_AT_REST,
    )
    iteration = CMPSP(problem, options)
    iterate = iteration.init(np.tile(guess, (steps + 1, 1)))
    first = float(np.linalg.norm(iterate.evaluation.output_error))
    controls = [iterate.U.ravel()]
    while len(controls) <= iterations and iteration.terminate(iterate) is None:
        iterate = iteration.step(iterate)
        controls.append(iterate.U.ravel())
    last = float(np.linalg.norm(iterate.evaluation.output_error))
    return Convergence(first, last, np.array(controls))


@dataclass(frozen=True)
class Conditions:
    """Numbers behind conditions (ii) and (iii) of Theorem 2."""

    size: int  # ``q``, number of unknowns
    rank_S_N: int  # rank of the output sensitivity (55)
    path_rows: int  # path constraints (92) (93) that are active
    wheel_rows: int  # wheel limits (94) that are active
    rank_G: int  # rank of ``G`` of Theorem 2
    # Minimum eigenvalue of the exact Hessian of (95), ``R`` of its second term included.
    least_eigenvalue: float
    neglected: float  # part of the Hessian of the first term that (45) leaves out, in norm

    @property
    def columns_G(self) -> int:
        """Columns of ``G``: outputs and active constraints."""
        return 2 + self.path_rows + self.wheel_rows


def measure_conditions(path: Path) -> Conditions:
    """Evaluate the conditions at the control history driven, seen from the start."""
    settings, weights = path.settings, path.settings.weights
    problem = GuidanceProblem(
        settings.robot,
        sample_space(settings, settings.world),
        replace(weights, control_effort=0.0),
        path.poses[0],
        np.array(settings.goal),
        path.durations,
    )
    U = np.vstack([path.controls, path.controls[-1:]])
    qp = _condensed(problem, U)
    path_rows = qp.B_C[qp.g < _ACTIVE]
    # The last control moves nothing and is not counted.
    wheel_rows = np.eye(U.size)[
        np.flatnonzero(settings.robot.max_wheel_speed - np.abs(U[:-1].ravel()) < _ACTIVE)
    ]
    exact = _exact_hessian(problem, U)
    gradients = np.vstack([qp.S_N, path_rows, wheel_rows])
    return Conditions(
        size=U.size,
        rank_S_N=int(np.linalg.matrix_rank(qp.S_N)),
        path_rows=len(path_rows),
        wheel_rows=len(wheel_rows),
        rank_G=int(np.linalg.matrix_rank(gradients)),
        least_eigenvalue=float(np.linalg.eigvalsh(exact).min()) + weights.control_change,
        neglected=float(np.linalg.norm(exact - _condensed_hessian(problem, path, U), 2))
        / float(np.linalg.norm(exact, 2)),
    )


def _improve(
    settings: GuidanceSettings, recipe: Recipe, pose: Array, guess: Array, durations: Array
) -> Array:
    goal, space = np.array(settings.goal), sample_space(settings, settings.world)
    kind = SquaredConstraints if recipe is Recipe.AS_WRITTEN else GuidanceProblem
    problem = kind(settings.robot, space, settings.weights, pose, goal, durations)
    obstacles = [PENALTIES['obstacle']] * len(settings.obstacles)
    terminal = np.full(2, PENALTIES['terminal_error'])
    path = np.array([PENALTIES['edge']] * N_EDGE_CONSTRAINTS + obstacles)
    iteration = CMPSP(problem, _options(settings, terminal, path, recipe is Recipe.ONE_PLAN))
    iterate = iteration.init(guess)
    for _ in range(settings.solver.iterations_per_step):
        iterate = iteration.step(iterate)
    return iterate.U


def _options(settings: GuidanceSettings, terminal: Array, path: Array, additions: bool) -> Options:
    trust = np.array([np.inf, np.inf, settings.solver.heading_trust_region])
    return Options(
        penalty_terminal=terminal,
        penalty_path=path,
        elastic=additions,
        line_search=additions,
        trust_radius=trust if additions else None,
    )


def _exact_hessian(problem: GuidanceProblem, U: Array) -> Array:
    """Second derivative of the cost by differences of its analytic gradient; no Gauss-Newton."""
    columns = []
    for direction in np.eye(U.size).reshape(-1, *U.shape):
        ahead = _condensed(problem, U + _DIFFERENCE * direction).c
        behind = _condensed(problem, U - _DIFFERENCE * direction).c
        columns.append((ahead - behind) / (2.0 * _DIFFERENCE))
    hessian = np.array(columns)
    return np.asarray((hessian + hessian.T) / 2.0)


def _condensed_hessian(problem: GuidanceProblem, path: Path, U: Array) -> Array:
    """Hessian (45) of the first term, with the exact second derivative of the stage cost."""
    settings = path.settings
    linear = problem.linearise(path.poses, U)
    out = path.poses[:, :2] - settings.world.annulus.center
    radius = np.linalg.norm(out, axis=1)
    along = np.column_stack([-out[:, 1], out[:, 0]]) / radius[:, None]
    bend = (settings.world.annulus.center_radius / radius)[:, None, None]
    L_XX = np.zeros_like(linear.L_XX)
    L_XX[:, :2, :2] = np.eye(2) - bend * along[:, :, None] * along[:, None, :]
    L_XX *= settings.weights.road_center
    linear = replace(linear, L_XX=L_XX, L_UU=np.zeros_like(linear.L_UU))
    return np.asarray(condense(linear, problem.control_lower - U, problem.control_upper - U).H)


def _condensed(problem: GuidanceProblem, U: Array) -> CondensedQP:
    linear = problem.linearise(problem.predict(U), U)
    return condense(linear, problem.control_lower - U, problem.control_upper - U)
