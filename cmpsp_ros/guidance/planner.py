"""Plans: the robot's problem posed from where it is, and improved by C-MPSP iterations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import Horizon
from cmpsp_ros.guidance.keep_clear import at_samples
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.mpsp.control_rate import ControlRateProblem
from cmpsp_ros.mpsp.iterate import SLACK_TOLERANCE, Iterate
from cmpsp_ros.mpsp.iteration import CMPSP, Options
from cmpsp_ros.mpsp.problem import OptimalControlProblem
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.robot.guidance_problem import EDGES, Cost, GuidanceProblem

Array = NDArray[np.float64]

# Cost of violating a constraint by a metre, in the merit function and in the relaxation. An
# obstacle outranks the road's edge, which outranks the goal.
_OBSTACLE_PENALTY = 1e4
_EDGE_PENALTY = 3e3
_GOAL_PENALTY = 1e3

# Without a wheel limit the arcs between samples are the plan's own, with this much room for the
# plan that comes out of the iterations to be faster or to turn faster.
_ROOM = 1.1


@dataclass(frozen=True)
class Improvement:
    """A plan after its iterations.

    Attributes:
        plan: The plan.
        solved: Whether the subproblem of the last iteration was solved.
        elastic: Whether slack was needed in it.
        slack: Largest violation that the slack stands for [m].
        slack_where: Indices of the path constraints it is in, outer and inner edge first.
        slack_terminal: Whether it is in the terminal constraint.
        iterations: Iterations done.
        qp_iterations: Iterations of the QP back end in the last one.
        active_rows: Constraints active in the last one.
        reason: What the last iteration came to, in words.
    """

    plan: Plan
    solved: bool
    elastic: bool
    slack: float
    slack_where: tuple[int, ...]
    slack_terminal: bool
    iterations: int
    qp_iterations: int
    active_rows: int
    reason: str


class Planner:
    """Improves control histories for one set of settings."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take road, obstacles, weights and solver from the settings."""
        self._settings = settings
        self._arcs_matter = settings.safety.between_samples and not np.isfinite(
            settings.robot.max_wheel_speed
        )
        self._goal = np.array(settings.goal)
        weights = settings.weights
        self._cost = Cost(
            settings.road.center_radius,
            weights.road_center,
            weights.control_change,
            weights.control_effort,
        )

    def improve(self, pose: Array, held: Array, guess: Array, horizon: Horizon) -> Improvement:
        """Run the iterations of one control step.

        Args:
            pose: Present pose, shape ``(3,)`` [m, m, rad].
            held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
            guess: Controls to start from, shape ``(N + 1, 2)`` [rad/s].
            horizon: Their horizon.
        """
        problem = self._problem(pose, held, guess, horizon)
        iteration = CMPSP(problem, self._options(problem))
        iterate = iteration.init(guess)
        while iterate.index < self._settings.solver.iterations_per_step:
            iterate = iteration.step(iterate)
            if iteration.terminate(iterate) is not None:
                break
        return _summary(iterate, horizon)

    def _problem(
        self, pose: Array, held: Array, guess: Array, horizon: Horizon
    ) -> OptimalControlProblem:
        settings, durations = self._settings, horizon.durations
        robot, longest = settings.robot, _rounded_up(float(durations.max()))
        space = at_samples(settings, longest)
        if self._arcs_matter:
            period = max(settings.control_period, longest)
            space = space.for_samples_of(_ROOM * robot.twist(guess[:-1]), period)
        problem = GuidanceProblem(robot, space, self._cost, pose, self._goal, durations)
        if settings.weights.control_rate > 0.0:
            return ControlRateProblem(problem, settings.weights.control_rate, held)
        return problem

    def _options(self, problem: OptimalControlProblem) -> Options:
        solver = self._settings.solver
        obstacles = problem.size.path - EDGES
        trust_radius = np.full(problem.size.state, np.inf)
        trust_radius[2] = solver.heading_trust_region or np.inf
        return Options(
            penalty_terminal=np.full(problem.size.output, _GOAL_PENALTY),
            penalty_path=np.array([_EDGE_PENALTY] * EDGES + [_OBSTACLE_PENALTY] * obstacles),
            qp=solver.qp,
            hessian=solver.hessian,
            trust_radius=trust_radius,
        )


def _rounded_up(duration: float) -> float:
    """To the next centisecond, so that late odometry does not ask for a new space each time."""
    return math.ceil(duration * 100.0 - 1e-6) / 100.0


def _summary(iterate: Iterate, horizon: Horizon) -> Improvement:
    plan = Plan(horizon, iterate.U, np.ascontiguousarray(iterate.X[:, :3]))
    step = iterate.step
    assert step is not None  # noqa: S101 (at least one iteration is always done)
    return Improvement(
        plan,
        step.qp_status is QPStatus.SOLVED,
        step.needed_slack,
        step.slack,
        tuple(np.flatnonzero(step.slack_path.max(axis=0) > SLACK_TOLERANCE).tolist()),
        bool(np.abs(step.slack_terminal).max() > SLACK_TOLERANCE),
        iterate.index,
        step.qp_iterations,
        step.active_rows,
        step.qp_status.value,
    )
