"""The robot's problem in Python, improved by `CMPSP`: what compiled plans are held against."""

import numpy as np

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.guidance_problem import GuidanceProblem
from cmpsp_ros.guidance.formulation.ocp_formulation import Task
from cmpsp_ros.guidance.planning.solve_result import Improvement
from cmpsp_ros.mpsp.iterate import SLACK_TOLERANCE
from cmpsp_ros.mpsp.models.control_rate import ControlRateProblem
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP


def improve(settings, pose, held, guess, horizon):
    task, solver, durations = Task(settings), settings.solver, horizon.durations
    space = task.space(guess, durations, pose)
    problem = GuidanceProblem(
        settings.model, space, task.cost, pose, task.goal, durations, task.heading, task.outputs
    )
    if settings.weights.control_rate > 0.0:
        problem = ControlRateProblem(problem, settings.weights.control_rate, held)
    trust_radius = np.full(problem.size.state, np.inf)
    trust_radius[2] = task.heading_trust_region
    options = Options(
        task.penalty_terminal, task.penalty_path, solver.qp, solver.hessian,
        trust_radius=trust_radius,
    )  # fmt: skip
    iteration = CMPSP(problem, options)
    iterate = iteration.init(guess)
    while iterate.index < solver.iterations_per_step:
        iterate = iteration.step(iterate)
        if iteration.terminate(iterate) is not None:
            break
    step = iterate.step
    return Improvement(
        Plan(horizon, iterate.U, iterate.X[:, :3]),
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
