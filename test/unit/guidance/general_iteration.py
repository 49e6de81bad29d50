"""The robot's problem in Python, improved by `CMPSP`: what compiled plans are held against."""

import numpy as np

from cmpsp_ros.guidance import Plan
from cmpsp_ros.guidance.formulation import GuidanceProblem, OcpFormulation
from cmpsp_ros.guidance.formulation.ocp_formulation import terminal_constraint, terminal_penalty
from cmpsp_ros.guidance.planning import SolveResult
from cmpsp_ros.mpsp import SLACK_TOLERANCE, Options
from cmpsp_ros.mpsp.models import ControlRateProblem
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.sqp import CMPSP
from cmpsp_ros.robots.motion import within_ramp


def improve(settings, pose, held, guess, horizon):
    formulation, solver, durations = (
        OcpFormulation(settings, settings.world),
        settings.solver,
        horizon.durations,
    )
    target = settings.target
    space = formulation.space(formulation.world, guess, durations, target, pose)
    goal, outputs = np.array(target.position), terminal_constraint(target)
    heading = np.nan if target.heading is None else target.heading
    problem = GuidanceProblem(
        settings.robot, space, settings.weights, pose, goal, durations, heading, outputs
    )
    if formulation.remembers_control:
        weight, limit = settings.weights.control_rate, settings.max_wheel_change
        problem = ControlRateProblem(problem, weight, held, limit, settings.robot.rate_limits)
        guess = within_ramp(guess, durations, held, limit, settings.robot.time_scaling)
    trust_radius = np.full(problem.size.state, np.inf)
    trust_radius[2] = formulation.heading_trust_region
    options = Options(
        terminal_penalty(outputs), formulation.penalty_path, solver.qp, solver.hessian,
        trust_radius=trust_radius,
    )  # fmt: skip
    iteration = CMPSP(problem, options)
    iterate = iteration.init(guess)
    while iterate.index < solver.iterations_per_step:
        iterate = iteration.step(iterate)
        if iteration.terminate(iterate) is not None:
            break
    step = iterate.step
    return SolveResult(
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
