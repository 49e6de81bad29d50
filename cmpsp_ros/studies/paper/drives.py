"""Closed-loop runs, and measures of the driven path, independent of what the law reports."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, warm_up
from cmpsp_ros.studies.closed_loop import drive
from cmpsp_ros.studies.paper.experiments import Experiment
from cmpsp_ros.view import along


@dataclass(frozen=True)
class Path:
    """A path driven under zero-order hold, and its controls.

    Attributes:
        settings: Of the law, or of the controller used instead.
        poses: At each control instant and at the end, shape ``(N + 1, 3)`` [m, m, rad].
        controls: Shape ``(N, r)``; of the paper's robot the speeds of its right and left wheel
            [rad/s].
    """

    settings: GuidanceSettings
    poses: Array
    controls: Array

    @property
    def times(self) -> Array:
        """Control instants and the end, shape ``(N + 1,)`` [s]."""
        return np.arange(len(self.poses), dtype=np.float64) * self.settings.control_period

    @property
    def durations(self) -> Array:
        """Length of every step, shape ``(N,)`` [s]."""
        return np.full(len(self.controls), self.settings.control_period)

    @property
    def miss(self) -> float:
        """Distance from the goal at the end [m]."""
        return math.dist(self.poses[-1, :2], self.settings.goal)

    @property
    def off_center(self) -> Array:
        """Distance outward from the centre line at each instant, shape ``(N + 1,)`` [m]."""
        road = self.settings.world.annulus
        off: Array = np.linalg.norm(self.poses[:, :2] - road.center, axis=1) - road.center_radius
        return off

    @property
    def cost(self) -> float:
        """Cost (95) of the path driven, its second term left out as that is of an iteration."""
        off = self.off_center
        return 0.5 * self.settings.weights.road_center * float(off @ off)

    def clearance(self, *, between_samples: bool) -> Array:
        """Least clearance from outer edge, inner edge and obstacles, shape ``(2 + M,)`` [m]."""
        settings = self.settings
        space = settings.world.free_space(settings)
        if between_samples:
            twists = settings.robot.twist(self.controls)
            clearance = space.along(self.poses[:-1], twists, self.durations)
        else:
            clearance = space.at(self.poses)
        least: Array = clearance.min(axis=0)
        return least

    def points(self) -> Array:
        """Positions along the path, several on each arc, shape ``(K, 2)`` [m]."""
        twists = self.settings.robot.twist(self.controls)
        return along(self.poses, twists, self.durations)

    def measures(self) -> dict[str, Any]:
        """The figures of this path, under the names that `results.json` has."""
        limit = self.settings.robot.max_wheel_speed
        right, left = self.controls.T
        return {
            'miss_m': self.miss,
            'clearance_at_samples_m': float(self.clearance(between_samples=False).min()),
            'clearance_between_samples_m': float(self.clearance(between_samples=True).min()),
            'max_right_rad_s': float(np.abs(right).max()),
            'max_left_rad_s': float(np.abs(left).max()),
            'limit_rad_s': limit if math.isfinite(limit) else None,
            'cost': self.cost,
        }


@dataclass(frozen=True)
class Drive:
    """A run of the guidance law.

    Attributes:
        experiment: Which run of the paper.
        between_samples: Whether the path between samples was constrained, too.
        path: The driven path.
        levels: Fallback level of each control step.
        step_times: Computing time of each control step [ms].
    """

    experiment: Experiment
    between_samples: bool
    path: Path
    levels: tuple[str, ...]
    step_times: Array

    def measures(self) -> dict[str, Any]:
        """The figures of this run; computing times are left out as they never repeat."""
        levels = {name: self.levels.count(name) for name in dict.fromkeys(self.levels)}
        return {**self.path.measures(), 'levels': levels}

    def series(self) -> dict[str, Any]:
        """The run as numbers."""
        x, y, heading = self.path.poses.T
        right, left = self.path.controls.T
        return {
            't_s': self.path.times.tolist(),
            'x_m': x.tolist(),
            'y_m': y.tolist(),
            'heading_rad': heading.tolist(),
            'right_rad_s': right.tolist(),
            'left_rad_s': left.tolist(),
        }


def run_law(experiment: Experiment, *, between_samples: bool) -> Drive:
    """Drive one run of the paper with the guidance law."""
    settings = _as_in_the_paper(experiment.with_bound(between_samples))
    pose = np.array(experiment.pose)
    decisions, times = [], []
    steps = drive(settings, pose)
    finished = False
    while not finished:
        began = time.perf_counter_ns()
        decision = next(steps)
        times.append((time.perf_counter_ns() - began) * 1e-6)
        decisions.append(decision)
        finished = decision.finished
    # The last decision only says that the time is over.
    wheel_speeds = np.array([decision.wheel_speeds for decision in decisions[:-1]])
    return Drive(
        experiment,
        between_samples,
        drive_open(settings, pose, wheel_speeds),
        tuple(decision.level.name.lower() for decision in decisions[:-1]),
        np.array(times[:-1]),
    )


def _as_in_the_paper(settings: GuidanceSettings) -> GuidanceSettings:
    """One plan, from the guess given, with as many iterations at the first step as at any other."""
    each = settings.solver.iterations_per_step
    return replace(settings, solver=replace(settings.solver, candidates=1, initial_iterations=each))


def drive_open(settings: GuidanceSettings, pose: Array, wheel_speeds: Array) -> Path:
    """The path that a history of wheel speeds ``(N, 2)`` [rad/s] leads along."""
    durations = np.full(len(wheel_speeds), settings.control_period)
    return Path(settings, settings.robot.roll_out(pose, wheel_speeds, durations), wheel_speeds)


def guessed_path(experiment: Experiment) -> Path:
    """Where the run's constant first guess would lead."""
    settings = experiment.settings
    steps = round(settings.final_time / settings.control_period)
    guess = np.tile(settings.initial_guess.wheel_speeds, (steps, 1))
    return drive_open(settings, np.array(experiment.pose), guess)


class Laboratory:
    """Runs every experiment once, for any number of figures."""

    def __init__(self, progress: Callable[[str], None], *, judge: bool = False) -> None:
        """Start with nothing run.

        Args:
            progress: Called with a line on the work in progress.
            judge: Whether an independent solver may be used.
        """
        self.progress = progress
        self.judge = judge
        self._drives: dict[tuple[str, bool], Drive] = {}

    def drive(self, experiment: Experiment, *, between_samples: bool) -> Drive:
        """The run, from memory if it was made before."""
        key = (experiment.key, between_samples)
        if key not in self._drives:
            if not self._drives:
                self.progress('loading compiled code')
                warm_up(experiment.settings)
            how = 'clear between samples' if between_samples else 'samples only'
            self.progress(f'driving {experiment.key}, {how}')
            self._drives[key] = run_law(experiment, between_samples=between_samples)
        return self._drives[key]

    def both(self, experiments: Sequence[Experiment]) -> tuple[list[Drive], list[Drive]]:
        """All of them twice: at samples only as in the paper, and clear between samples too."""
        return (
            [self.drive(each, between_samples=False) for each in experiments],
            [self.drive(each, between_samples=True) for each in experiments],
        )
