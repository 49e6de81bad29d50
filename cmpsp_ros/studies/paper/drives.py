"""Closed-loop runs, and measures of the driven path, independent of reports of the law."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance import GuidanceSettings, warm_up
from cmpsp_ros.studies.closed_loop import drive
from cmpsp_ros.studies.paper.experiments import Experiment
from cmpsp_ros.view import along

ARRIVED = 1e-6  # distance from the goal up to which a run counts as having met it [m]

# Clearance down to which an active constraint counts as met [m]: rounding of a linearisation.
TOUCHED = -1e-6


@dataclass(frozen=True)
class Path:
    """A path driven under zero-order hold, and its controls."""

    settings: GuidanceSettings  # of the law, or of the controller used instead
    poses: Array  # at each control instant and at the end, shape ``(N + 1, 3)`` [m, m, rad]
    # Shape ``(N, r)``; of the paper's robot the speeds of its right and left wheel [rad/s].
    controls: Array

    @classmethod
    def open_loop(cls, settings: GuidanceSettings, pose: Array, controls: Array) -> Path:
        """Path under a history of controls ``(N, r)`` from a pose ``(3,)``."""
        durations = np.full(len(controls), settings.control_period)
        return cls(settings, settings.robot.roll_out(pose, controls, durations), controls)

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

    @property
    def peaks(self) -> Array:
        """Maximum magnitude of each control, shape ``(r,)``."""
        return np.asarray(np.abs(self.controls).max(axis=0))

    @property
    def saturated(self) -> BoolArray:
        """Wheels at their limit at each step, shape ``(N, 2)``."""
        return np.asarray(np.abs(self.controls) >= self.settings.robot.max_wheel_speed - 1e-6)

    def clearance(self, *, between_samples: bool) -> Array:
        """Minimum clearance from outer edge, inner edge and obstacles, shape ``(2 + M,)`` [m]."""
        space = self.settings.world.free_space(self.settings)
        if between_samples:
            twists = self.settings.robot.twist(self.controls)
            clearance = space.along(self.poses[:-1], twists, self.durations)
        else:
            clearance = space.at(self.poses)
        return np.asarray(clearance.min(axis=0))

    def points(self) -> Array:
        """Positions along the path, several on each arc, shape ``(K, 2)`` [m]."""
        return along(self.poses, self.settings.robot.twist(self.controls), self.durations)

    def measures(self) -> dict[str, Any]:
        """Figures of this path, under the names that `results.json` has."""
        limit = self.settings.robot.max_wheel_speed
        right, left = self.peaks.tolist()
        return {
            'miss_m': self.miss,
            'clearance_at_samples_m': float(self.clearance(between_samples=False).min()),
            'clearance_between_samples_m': float(self.clearance(between_samples=True).min()),
            'max_right_rad_s': right,
            'max_left_rad_s': left,
            'limit_rad_s': limit if math.isfinite(limit) else None,
            'cost': self.cost,
        }


@dataclass(frozen=True)
class Drive:
    """A run of the guidance law."""

    experiment: Experiment
    between_samples: bool  # True if the path between samples was constrained, too
    path: Path
    levels: tuple[str, ...]  # fallback level of each control step
    step_times: Array  # computing time of each control step [ms]

    @property
    def steps_with_slack(self) -> int:
        """Steps at another level than nominal."""
        return sum(level != 'nominal' for level in self.levels)

    def measures(self) -> dict[str, Any]:
        """Figures of this run; computing times are left out as they never repeat."""
        levels = {name: self.levels.count(name) for name in dict.fromkeys(self.levels)}
        return {**self.path.measures(), 'levels': levels}

    def series(self) -> dict[str, list[float]]:
        """Time series of the run by the names that `results.json` has."""
        path = self.path
        columns = path.times, *path.poses.T, *path.controls.T
        names = 't_s', 'x_m', 'y_m', 'heading_rad', 'right_rad_s', 'left_rad_s'
        return {name: column.tolist() for name, column in zip(names, columns, strict=True)}


class Panels(NamedTuple):
    """The same runs with constraints at samples only, as in the paper, and between samples too."""

    plain: list[Drive]
    bound: list[Drive]

    @property
    def drives(self) -> list[Drive]:
        """All runs."""
        return [*self.plain, *self.bound]

    def numbers(self, series: Sequence[str]) -> dict[str, Any]:
        """Runs for `results.json`, by panel and by name, with these of their time series."""
        return {
            name: {
                drive.experiment.key: {
                    **{each: drive.series()[each] for each in series},
                    'measures': drive.measures(),
                }
                for drive in drives
            }
            for name, drives in zip(('samples_only', 'between_samples'), self, strict=True)
        }


def run_law(experiment: Experiment, *, between_samples: bool) -> Drive:
    """Drive one run of the paper with the guidance law."""
    given = experiment.with_bound(between_samples)
    # As in the paper: one plan, from the guess given, with as many iterations in every step.
    each = given.solver.iterations_per_step
    solver = replace(given.solver, candidates=1, initial_iterations=each)
    settings, pose = replace(given, solver=solver), np.array(experiment.pose)
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
        Path.open_loop(settings, pose, wheel_speeds),
        tuple(decision.level.name.lower() for decision in decisions[:-1]),
        np.array(times[:-1]),
    )


def guessed_path(experiment: Experiment) -> Path:
    """Path of the run's constant first guess."""
    settings = experiment.settings
    steps = round(settings.final_time / settings.control_period)
    guess = np.tile(settings.initial_guess.wheel_speeds, (steps, 1))
    return Path.open_loop(settings, np.array(experiment.pose), guess)


def worst_miss(drives: Iterable[Drive]) -> float:
    """Maximum miss [m]."""
    return max(drive.path.miss for drive in drives)


def least_clearance(drives: Iterable[Drive], *, between_samples: bool) -> float:
    """Minimum clearance from road edges and obstacles [m]."""
    return min(
        float(drive.path.clearance(between_samples=between_samples).min()) for drive in drives
    )


def within_limits(drives: Iterable[Drive]) -> bool:
    """True if no wheel is ever faster than its limit."""
    return all(each.path.peaks.max() <= each.path.settings.robot.max_wheel_speed for each in drives)


def apart(paths: Sequence[Path]) -> Array:
    """Maximum distance at equal times between each two paths, in the order of pairs [m]."""
    pairs = combinations([path.poses[:, :2] for path in paths], 2)
    return np.array([np.linalg.norm(one - other, axis=1).max() for one, other in pairs])


def wheels_apart(paths: Sequence[Path]) -> Array:
    """Maximum difference of a wheel speed at equal times, in the order of pairs [rad/s]."""
    pairs = combinations([path.controls for path in paths], 2)
    return np.array([np.abs(one - other).max() for one, other in pairs])


def spans(active: BoolArray) -> int:
    """Number of uninterrupted spans in which a flag is set."""
    padded = np.concatenate([[False], active])
    return int(np.count_nonzero(~padded[:-1] & padded[1:]))


class Laboratory:
    """Every experiment, run once for any number of figures."""

    def __init__(self, progress: Callable[[str], None], *, judge: bool = False) -> None:
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

    def both(self, experiments: Sequence[Experiment]) -> Panels:
        """All of them, at samples only and clear between samples too."""
        return Panels(
            [self.drive(each, between_samples=False) for each in experiments],
            [self.drive(each, between_samples=True) for each in experiments],
        )
