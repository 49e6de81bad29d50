"""The paper's scenarios, an exact robot, and a judge of the path that it drives."""

import math
from dataclasses import dataclass, field, replace

import numpy as np

from cmpsp_ros.guidance import (
    Decision,
    FallbackLevel,
    GuidanceLaw,
    GuidanceSettings,
    InitialGuess,
    Observation,
    SolverSettings,
    severity,
)
from cmpsp_ros.guidance.planning import PlanningContext
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus

MS = 1_000_000
PERIOD = 200 * MS
START = (0.0, -9.25, 0.0)
FIRST = Obstacle('first', (8.0, -6.0), 0.7)
SECOND = Obstacle('second', (10.0, -2.0), 0.5)
PAPER = InitialGuess('constant', (45.13, 44.63))
ROAD = InitialGuess('road')
ON_TIME = [k * PERIOD for k in range(51)]
SETTLED = {FallbackLevel.NOMINAL, FallbackLevel.ELASTIC}


def settings(obstacles=(), limit=math.inf, guess=PAPER, **changes):
    given = GuidanceSettings(
        robot=DifferentialDrive(max_wheel_speed=limit),
        road=Annulus(),
        goal=(10.0, 0.0),
        obstacles=obstacles,
        initial_guess=guess,
        # As in the presets.
        solver=SolverSettings() if guess == ROAD else SolverSettings(initial_iterations=6),
    )
    return replace(given, **changes)


CASES = {
    'case 1': settings(),
    'case 2': settings((FIRST, SECOND)),
    'case 3': settings((FIRST, SECOND), 51.0),
}


def law_of(given):
    """The law in the world of its settings."""
    return GuidanceLaw(given, given.world)


def reconfigure(law, given):
    """Give a law other settings, and their world."""
    law.reconfigure(given, given.world)


def with_plans(given, candidates, initial_iterations=6):
    """The same settings with so many plans to choose from; 1 and 2 iterations are the paper's."""
    solver = replace(given.solver, candidates=candidates, initial_iterations=initial_iterations)
    return replace(given, solver=solver)


def start_of(given, pose, **rest):
    """Start of a plan, for the robot of the settings."""
    return PlanStart(np.array(pose, dtype=float), given.robot, given.world, **rest)


def context_of(given, pose, horizon, previous_control=(0.0, 0.0)):
    """A control step to plan for."""
    pose, previous_control = np.array(pose, dtype=float), np.array(previous_control)
    return PlanningContext.at_pose(given, given.world, pose, horizon, previous_control)


@dataclass
class Run:
    """Outcome of a closed loop: decisions, and the robot's place at the end of each."""

    decisions: list[Decision] = field(default_factory=list)
    driven: list[np.ndarray] = field(default_factory=list)
    pose: np.ndarray = field(default_factory=lambda: np.array(START))

    @property
    def moves(self):
        return [decision for decision in self.decisions if not decision.finished]

    @property
    def path(self):
        return np.vstack(self.driven)

    @property
    def controls(self):
        return np.array([decision.wheel_speeds for decision in self.decisions])

    def miss(self, goal=(10.0, 0.0)):
        return math.dist(self.pose[:2], goal)


def clearance(path, given):
    """Least clearance of points from road edges and obstacles, by nothing but distances."""
    radius = np.linalg.norm(path[:, :2] - given.road.center, axis=1)
    parts = [given.road.outer_radius - radius, radius - given.road.inner_radius]
    for obstacle in given.obstacles:
        away = np.linalg.norm(path[:, :2] - obstacle.center, axis=1)
        parts.append(away - obstacle.radius)
    return float(np.min(parts))


def drive(law, given, stamps, start=START, pieces=40, before=None):
    """Odometry at the stamps [ns], the exact robot in between until the last of them.

    Args:
        law: The guidance law.
        given: Its settings.
        stamps: When odometry comes, increasing.
        start: First pose.
        pieces: Points of the path that are kept from one stamp to the next.
        before: Called as ``before(run, stamp)`` ahead of each update.
    """
    run = Run(pose=np.array(start, dtype=float))
    run.driven.append(run.pose[None])
    held = np.zeros(2)
    for stamp, after in zip(stamps, [*stamps[1:], None], strict=True):
        if before is not None:
            before(run, stamp)
        decision = law.step(Observation(stamp, run.pose.copy()))
        if decision is not None:
            run.decisions.append(decision)
            held = decision.wheel_speeds
        if after is not None:
            times = np.full(pieces, (after - stamp) / 1e9 / pieces)
            path = given.robot.roll_out(run.pose, np.tile(held, (pieces, 1)), times)
            run.driven.append(path[1:])
            run.pose = path[-1]
    return run


def closed_loop(given, start=START, steps=50, before=None):
    """The law on time: odometry at every control instant, and at the final time."""
    law = GuidanceLaw(given, given.world)
    stamps = [1_000_000_007 + k * PERIOD for k in range(steps + 1)]
    return drive(law, given, stamps, start, before=before)


def after(run, given):
    """Pose of the robot at the control instant after a run."""
    wheels = run.decisions[-1].wheel_speeds[None]
    return given.robot.roll_out(run.pose, wheels, np.array([PERIOD / 1e9]))[-1]


def exhausted(given):
    """The same settings with too little work for any subproblem."""
    return replace(given, solver=replace(given.solver, work_share=1e-6))


def assert_is(fault, decision):
    """A decision fits the row of doc/reference/faults.md that names the test."""
    fault.assert_said(decision.level.name.lower(), severity(decision), decision.reason)
