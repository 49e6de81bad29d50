"""Plans improved with any QP back end: slower, for comparison and for the exact Hessian."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.guidance_problem import GuidanceProblem
from cmpsp_ros.guidance.formulation.ocp_formulation import Task
from cmpsp_ros.guidance.horizon import Horizon
from cmpsp_ros.guidance.planning.solve_result import Improvement
from cmpsp_ros.mpsp.control_rate import ControlRateProblem
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.problem import OptimalControlProblem
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP
from cmpsp_ros.mpsp.sqp.iterate import SLACK_TOLERANCE, Iterate
from cmpsp_ros.world.obstacles.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]


class BackEndPlanner:
    """Improves control histories by the general iteration."""

    def __init__(self, task: Task) -> None:
        """Take the task."""
        self._task = task

    def improve(
        self,
        pose: Array,
        held: Array,
        guess: Array,
        horizon: Horizon,
        *,
        iterations: int | None = None,
        moving: MovingDiscs = NOTHING_MOVES,
        near: float = math.nan,
    ) -> Improvement:
        """As `cmpsp_ros.guidance.planning.planner.Planner.improve`."""
        problem = self.problem(pose, held, guess, horizon, moving, near)
        iteration = CMPSP(problem, self.options(problem))
        iterate = iteration.init(guess)
        most = iterations or self._task.settings.solver.iterations_per_step
        while iterate.index < most:
            iterate = iteration.step(iterate)
            if iteration.terminate(iterate) is not None:
                break
        return _summary(iterate, horizon)

    def problem(
        self,
        pose: Array,
        held: Array,
        guess: Array,
        horizon: Horizon,
        moving: MovingDiscs = NOTHING_MOVES,
        near: float = math.nan,
    ) -> OptimalControlProblem:
        """The problem from a pose on; arguments as of `improve`."""
        task, durations = self._task, horizon.durations
        space, robot = task.space(guess, durations, pose, moving), task.settings.model
        problem = GuidanceProblem(
            robot, space, task.cost, pose, task.goal, durations, task.heading, task.outputs, near
        )
        rate = task.settings.weights.control_rate
        return ControlRateProblem(problem, rate, held) if rate > 0.0 else problem

    def options(self, problem: OptimalControlProblem) -> Options:
        """How the iteration is run on a problem."""
        task, solver = self._task, self._task.settings.solver
        trust_radius = np.full(problem.size.state, np.inf)
        trust_radius[2] = task.heading_trust_region
        return Options(
            penalty_terminal=task.penalty_terminal,
            penalty_path=task.penalty_path,
            qp=solver.qp,
            hessian=solver.hessian,
            trust_radius=trust_radius,
        )


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
