"""The same iterations by `CMPSP` and in compiled code, and tasks of the robot to run them on."""

from dataclasses import replace

import numpy as np

from cmpsp_ros.mpsp.iterate import SLACK_TOLERANCE
from cmpsp_ros.mpsp.iteration import CMPSP, Options
from cmpsp_ros.mpsp.qp import QPStatus
from cmpsp_ros.mpsp.realtime.iteration import (
    ACTIVE_ROWS,
    DONE,
    OUTCOME,
    RELAXED,
    Rules,
    improve,
    needs_slack,
)
from cmpsp_ros.mpsp.realtime.packed import pack
from cmpsp_ros.mpsp.realtime.workspace import workspace
from cmpsp_ros.mpsp.riccati.outcome import SOLVED
from cmpsp_ros.robot.clear_space import ClearSpace
from cmpsp_ros.robot.differential_drive import DifferentialDrive
from cmpsp_ros.robot.guidance_problem import Cost, GuidanceProblem
from cmpsp_ros.robot.obstacles import Obstacle
from cmpsp_ros.robot.road import Annulus

POSE, GOAL = np.array([0.0, -9.25, 0.0]), np.array([10.0, 0.0])
OBSTACLES = Obstacle('first', (8.0, -6.0), 0.7), Obstacle('second', (10.0, -2.0), 0.5)


def robot_problem(steps=25, limit=51.0, obstacles=OBSTACLES, pose=POSE, change=1.0):
    road = Annulus()
    return GuidanceProblem(
        DifferentialDrive(max_wheel_speed=limit),
        ClearSpace.of(road, obstacles, 0.05),
        Cost(15.0, change, 0.0),
        pose,
        GOAL,
        np.full(steps, 10.0 / steps),
    )


def robot_options(problem, **changes):
    obstacles = problem.size.path - 2
    given = Options(
        penalty_terminal=np.full(2, 1e3),
        penalty_path=np.array([3e3] * 2 + [1e4] * obstacles),
        trust_radius=np.array([np.inf, np.inf, 0.6]),
    )
    return replace(given, **changes)


def room_for(problem, options, longest=None):
    """A packed workspace for a problem with the same bounds at all stages."""
    size = replace(problem.size, horizon=longest or problem.size.horizon)
    free = np.full(size.state, np.inf)
    trust_radius = free if options.trust_radius is None else options.trust_radius
    room = workspace(size, options.penalty_terminal, options.penalty_path, trust_radius)
    room.lower[:], room.upper[:] = problem.control_lower[0], problem.control_upper[0]
    return pack(room)


def rules(problem, options, iterations):
    target = float(np.linalg.norm(problem.target)) or 1.0
    return Rules(
        iterations=iterations,
        line_search=options.line_search,
        output_tolerance=options.output_tolerance * target,
        control_tolerance=options.control_tolerance,
        violation_tolerance=options.violation_tolerance,
        slack_tolerance=SLACK_TOLERANCE,
        growth_limit=options.growth_limit,
    )


def improved(problem, data, options, guess, iterations, at=None, over=None):
    """The room after so many compiled iterations, on as many stages as the guess has."""
    packed, room = at or room_for(problem, options)
    room.at.U[: len(guess)] = guess
    over = len(room.lower) if over is None else over
    improve(data, packed, len(guess) - 1, over, rules(problem, options, iterations))
    return room


def iterates(problem, options, guess, iterations):
    """All iterates of `CMPSP`, the guess first, until it ends by itself or at the limit."""
    iteration = CMPSP(problem, options)
    run = [iteration.init(guess)]
    while len(run) <= iterations:
        run.append(iteration.step(run[-1]))
        if iteration.terminate(run[-1]) is not None:
            break
    return run


def assert_same(room, iterate, options, rtol=1e-9):
    """A room and an iterate of `CMPSP` hold the same, to rounding."""
    step, evaluation = iterate.step, iterate.evaluation
    stages = len(iterate.U)
    size = 1.0 + np.abs(iterate.U).max()
    np.testing.assert_allclose(room.at.U[:stages], iterate.U, rtol=0.0, atol=rtol * size)
    np.testing.assert_allclose(room.at.X[:stages], iterate.X, rtol=0.0, atol=rtol * size)
    np.testing.assert_allclose(room.at.cost[0], evaluation.cost, rtol=1e-8, atol=rtol)
    np.testing.assert_allclose(room.at.output_error, evaluation.output_error, atol=rtol * size)
    assert room.counts[DONE] == iterate.index
    assert (room.counts[OUTCOME] == SOLVED) == (step.qp_status is QPStatus.SOLVED)
    assert bool(room.counts[RELAXED]) == step.elastic
    if step.qp_status is QPStatus.SOLVED:
        assert room.counts[ACTIVE_ROWS] == step.active_rows
        assert needs_slack(room, rules_of(options)) == step.needed_slack
        if step.elastic:
            found = max(room.slack.max(), 0.0)
            np.testing.assert_allclose(found, step.slack, rtol=1e-7, atol=1e-9)


def rules_of(options):
    return Rules(1, options.line_search, 0.0, 0.0, 0.0, SLACK_TOLERANCE, options.growth_limit)
