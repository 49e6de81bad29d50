"""Subproblems along closed loops of the robot, as the guidance law meets them."""

from collections.abc import Generator, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.verify.case import Draft, Program, Rng
from benchmarks.verify.programs.scenario import Maker, RobotScenario
from benchmarks.verify.references import clarabel_solve
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, Horizon, remaining, shift, to_nanoseconds
from cmpsp_ros.guidance.formulation import N_EDGE_CONSTRAINTS, GuidanceProblem, sample_space
from cmpsp_ros.guidance.planning import initial_guess
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.mpsp import OptimalControlProblem
from cmpsp_ros.mpsp.models import ControlRateProblem
from cmpsp_ros.mpsp.qp import Penalties, QPStatus, Subproblem

# Kind of a subproblem, the subproblem, and the one before it.
Visit = tuple[str, Subproblem, Subproblem]

_ITERATIONS = 2
_VISITS = 3
_OTHER_START = 0.25


@dataclass(frozen=True)
class Weights:
    """Penalties of goal, road edges and obstacles for one unit of violation."""

    goal: float
    edge: float
    obstacle: float


# Weights as large as the guidance law's: a relaxed program gives way only where it must.
LARGE = Weights(1e3, 3e3, 1e4)

SMALL = (Weights(100.0, 1e3, 1e3), Weights(10.0, 30.0, 100.0))  # so small that many rows give way


def loops(make: Maker, rng: Rng) -> Iterator[Draft]:
    """Programs from one closed loop after the other, hard and relaxed, without end."""
    while True:
        yield from _loop(make(rng), rng)


def subproblems(make: Maker, rng: Rng) -> Iterator[tuple[str, Subproblem]]:
    """Only the subproblems of such loops, first iterations only, without end."""
    while True:
        scenario = make(rng)
        for about, subproblem, _ in _visits(scenario, rng):
            yield about, subproblem


def penalties(subproblem: Subproblem, weights: Weights) -> Penalties:
    """Weights of every row of one of the robot's programs."""
    stages, paths = subproblem.linearisation.g.shape
    path = np.full((stages, paths), weights.obstacle)
    path[:, :N_EDGE_CONSTRAINTS] = weights.edge
    return Penalties(np.full(len(subproblem.linearisation.output_error), weights.goal), path)


def _loop(scenario: RobotScenario, rng: Rng) -> Iterator[Draft]:
    for about, subproblem, before in _visits(scenario, rng):
        small = SMALL[rng.integers(len(SMALL))]
        weights = LARGE if rng.random() < 0.6 else small
        hard = Program(subproblem)
        relaxed = Program(subproblem, penalties(subproblem, weights))
        yield Draft(f'{about}, hard', hard, Program(before))
        # As in the guidance law: the relaxed program after the hard one it is made of.
        earlier = hard if rng.random() < 0.5 else Program(before, relaxed.penalties)
        yield Draft(f'{about}, relaxed at {weights.goal:g}', relaxed, earlier)


def _visits(scenario: RobotScenario, rng: Rng) -> Iterator[Visit]:
    """A few control steps of one loop, each with its iterations."""
    settings, pose = scenario.settings, scenario.pose
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    steps, step = round(final / period), 0
    U, horizon = np.empty((0, 2)), None
    for _ in range(_VISITS):
        late = int(rng.uniform(0.0, 0.2) * period) if rng.random() < 0.3 else 0
        coming = remaining(min(step * period + late, final - 1), period, final)
        if horizon is None:
            guess = initial_guess(
                settings,
                PlanStart(pose, settings.robot, settings.world),
                settings.target,
                coming.durations,
            )
        else:
            guess = shift(U, horizon, coming)
        horizon = coming
        problem = _pose_problem(settings, pose, guess, horizon)
        about = f'{scenario.name}, N = {problem.size.horizon}, step {step}'
        U = yield from _iterations(about, problem, settings, guess, rng)
        ahead = int(rng.integers(1, max(2, problem.size.horizon // 2)))
        if step + ahead >= steps:
            return
        step += ahead
        driven = settings.robot.roll_out(pose, U[:ahead], horizon.durations[:ahead])
        pose = driven[-1] + rng.choice([0.0, 1e-3, 0.05]) * rng.normal(size=3)


def _iterations(
    about: str, problem: OptimalControlProblem, settings: GuidanceSettings, guess: Array, rng: Rng
) -> Generator[Visit, None, Array]:
    """The iterations of one control step; returns its controls."""
    U = np.clip(guess, problem.control_lower, problem.control_upper)
    before = _elsewhere(problem, settings, U, rng)
    for iteration in range(_ITERATIONS):
        subproblem = _subproblem(problem, settings, U)
        yield f'{about}, iteration {iteration + 1}', subproblem, before
        before = subproblem
        U = np.clip(U + _answer(subproblem), problem.control_lower, problem.control_upper)
    return U


def _pose_problem(
    settings: GuidanceSettings, pose: Array, held: Array, horizon: Horizon
) -> OptimalControlProblem:
    weights, durations = settings.weights, horizon.durations
    space = sample_space(settings, settings.world, float(durations.max()))
    problem = GuidanceProblem(
        settings.robot, space, weights, pose, np.array(settings.goal), durations
    )
    if weights.control_rate > 0.0:
        return ControlRateProblem(problem, weights.control_rate, held[0])
    return problem


def _subproblem(problem: OptimalControlProblem, settings: GuidanceSettings, U: Array) -> Subproblem:
    trust_radius = np.full(problem.size.state, np.inf)
    trust_radius[2] = settings.solver.heading_trust_region or np.inf
    linearisation = problem.linearise(problem.predict(U), U, settings.solver.hessian)
    lower, upper = problem.control_lower - U, problem.control_upper - U
    return Subproblem(linearisation, lower, upper, trust_radius)


def _elsewhere(
    problem: OptimalControlProblem, settings: GuidanceSettings, U: Array, rng: Rng
) -> Subproblem:
    """The program of other controls: slightly, as after a control step, or far from these."""
    size = 5.0 if rng.random() < _OTHER_START else 0.1
    other = U + size * rng.normal(size=U.shape)
    other = np.clip(other, problem.control_lower, problem.control_upper)
    return _subproblem(problem, settings, other)


def _answer(subproblem: Subproblem) -> Array:
    """The step that the guidance law would take, by a solver that is not under test."""
    answer = clarabel_solve(Program(subproblem))
    if answer.status is not QPStatus.SOLVED:
        answer = clarabel_solve(Program(subproblem, penalties(subproblem, LARGE)))
    return answer.dU if answer.status is QPStatus.SOLVED else np.zeros_like(subproblem.lower)
