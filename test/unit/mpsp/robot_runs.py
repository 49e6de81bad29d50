"""The same iterations by `CMPSP` and in compiled code, on tasks of the robot."""

from dataclasses import replace

import numpy as np

from cmpsp_ros.guidance import Weights
from cmpsp_ros.guidance.formulation import FUNCTIONS, GuidanceProblem
from cmpsp_ros.mpsp import SLACK_TOLERANCE, Options
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp import CMPSP, Driver
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus

POSE, GOAL = np.array([0.0, -9.25, 0.0]), np.array([10.0, 0.0])
OBSTACLES = Obstacle('first', (8.0, -6.0), 0.7), Obstacle('second', (10.0, -2.0), 0.5)


def robot_problem(steps=25, limit=51.0, obstacles=OBSTACLES, pose=POSE, change=1.0):
    return GuidanceProblem(
        DifferentialDrive(max_wheel_speed=limit),
        FreeSpace.of(Annulus(), obstacles, 0.05),
        Weights(15.0, change),
        pose,
        GOAL,
        np.full(steps, 10.0 / steps),
    )


def robot_options(problem, **changes):
    given = Options(
        penalty_terminal=np.full(2, 1e3),
        penalty_path=np.array([3e3] * 2 + [1e4] * (problem.size.path - 2)),
        trust_radius=np.array([np.inf, np.inf, 0.6] + [np.inf] * (problem.size.state - 3)),
    )
    return replace(given, **changes)


def driver_for(problem, options, longest=None):
    """Memory for a problem with the same bounds at all stages."""
    size = replace(problem.size, horizon=longest or problem.size.horizon)
    trust_radius = options.trust_radius
    if trust_radius is None:
        trust_radius = np.full(size.state, np.inf)
    driver = Driver(size, options.penalty_terminal, options.penalty_path, trust_radius)
    driver.ws.lower[:], driver.ws.upper[:] = problem.control_lower[0], problem.control_upper[0]
    run, target = driver.ws.run, float(np.linalg.norm(problem.target)) or 1.0
    run['line_search'], run['elastic'] = options.line_search, options.elastic
    run['output_tolerance'] = options.output_tolerance * target
    run['slack_tolerance'] = SLACK_TOLERANCE
    for name in ('control_tolerance', 'violation_tolerance', 'growth_limit'):
        run[name] = getattr(options, name)
    return driver


def improve(driver, data, guess, iterations, over=1 << 20, functions=None):
    """So many compiled iterations, on as many stages as the guess has; returns the workspace."""
    ws = driver.ws
    ws.trial.U[: len(guess)] = guess
    ws.run['max_iterations'] = iterations
    entries = functions or FUNCTIONS.entries(data, ws)
    driver.improve(entries, data, len(guess) - 1, over)
    return ws


def iterates(problem, options, guess, iterations):
    """All iterates of `CMPSP`, the guess first, until it ends by itself or at the limit."""
    iteration = CMPSP(problem, options)
    run = [iteration.init(guess)]
    while len(run) <= iterations:
        run.append(iteration.step(run[-1]))
        if iteration.terminate(run[-1]) is not None:
            break
    return run


def assert_same(ws, iterate, rtol=1e-9):
    """A workspace and an iterate of `CMPSP` hold the same, to rounding."""
    run, step, evaluation = ws.run[0], iterate.step, iterate.evaluation
    stages = len(iterate.U)
    size = 1.0 + np.abs(iterate.U).max()
    np.testing.assert_allclose(ws.now.U[:stages], iterate.U, rtol=0.0, atol=rtol * size)
    np.testing.assert_allclose(ws.now.X[:stages], iterate.X, rtol=0.0, atol=rtol * size)
    np.testing.assert_allclose(run['cost'], evaluation.cost, rtol=1e-8, atol=rtol)
    np.testing.assert_allclose(ws.now.output_error, evaluation.output_error, atol=rtol * size)
    assert run['iterations'] == iterate.index
    assert (run['outcome'] == Outcome.SOLVED) == (step.qp_status is QPStatus.SOLVED)
    assert (run['level'] > 0) == step.elastic
    assert run['length'] == step.length
    if step.qp_status is QPStatus.SOLVED:
        assert run['active_rows'] == step.active_rows
        np.testing.assert_allclose(run['full_change'], step.full_change, rtol=1e-6, atol=1e-12)
        if step.elastic:
            np.testing.assert_allclose(ws.slack.max(initial=0.0), step.slack, rtol=1e-7, atol=1e-9)
