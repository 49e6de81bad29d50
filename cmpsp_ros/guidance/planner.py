"""Plans: the robot's problem posed from where it is, and improved by C-MPSP iterations."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.back_end_planner import BackEndPlanner
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import Horizon, remaining, steps_over, to_nanoseconds
from cmpsp_ros.guidance.improvement import Improvement
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.guidance.task import Task
from cmpsp_ros.mpsp.iterate import SLACK_TOLERANCE
from cmpsp_ros.mpsp.iteration import Options

# Imported whole: a file that takes names from it counts as one with kernels of its own.
from cmpsp_ros.mpsp.jit import compiled
from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPStatus
from cmpsp_ros.mpsp.realtime.control_rate import ControlRateData
from cmpsp_ros.mpsp.realtime.iteration import (
    ACTIVE_ROWS,
    DONE,
    OUTCOME,
    QP_ITERATIONS,
    RELAXED,
    Rules,
    improve,
)
from cmpsp_ros.mpsp.realtime.packed import Packed, pack
from cmpsp_ros.mpsp.realtime.workspace import Workspace, workspace
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, NO_CURVATURE, SOLVED
from cmpsp_ros.robot.clear_space import ClearSpace
from cmpsp_ros.robot.guidance_functions import GuidanceData
from cmpsp_ros.robot.guidance_problem import (
    begun_at,
    guidance_data,
    target_of,
    with_parameters,
)
from cmpsp_ros.robot.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]

# What the general iteration has more means for.
_WANTING: Final = (NO_CURVATURE, ITERATION_LIMIT)
_REASONS: Final = {SOLVED: QPStatus.SOLVED.value, INFEASIBLE: QPStatus.INFEASIBLE.value}


class Planner:
    """Improves control histories for one set of settings.

    One for every plan that is improved side by side with others. It keeps room for the longest
    horizon, and the active constraints of its last plan for the next one to begin with; they
    change the way to the solution of a subproblem, not the solution.
    """

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take road, obstacles, weights and solver from the settings."""
        self._task = Task(settings)
        self._back_end = BackEndPlanner(self._task)
        solver = settings.solver
        self._compiled = solver.qp == RICCATI_ACTIVE_SET and solver.hessian != 'exact'
        self._make_rules()
        self._rate = settings.weights.control_rate
        self._space: ClearSpace | None = None
        self._given: GuidanceData
        self._horizon: Horizon | None = None
        longest = _longest(settings)
        # Room is made for one number of outputs, and kept for when it is asked for again.
        self._rooms: dict[int, tuple[Packed, Workspace]] = {}
        self._enter_room(len(longest.durations))
        if self._compiled:
            nothing = np.zeros((len(longest.edges), 2))
            data = self._data(np.zeros(3), nothing[0], nothing, longest)
            self._improve = compiled.entry_for(improve, data, self._packed, 1, 0, self._rules)

    def aim(self, settings: GuidanceSettings) -> None:
        """Take another goal; nothing else of the settings may differ."""
        task, outputs = self._task, self._task.outputs
        task.aim(settings)
        self._make_rules()
        if self._space is not None:
            self._given = with_parameters(self._given, goal=task.goal, heading=task.heading)
        if task.outputs != outputs:
            self._enter_room(len(_longest(settings).durations))

    def forget(self) -> None:
        """Begin the next plan without what is known of the last one."""
        self._horizon = None
        # All of it: a plan may not depend on which planner another one was made by.
        for hint in (self._room.solver.hint_hard, self._room.solver.hint_relaxed):
            hint.length[0] = 0

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
        """Run iterations.

        Args:
            pose: Present pose, shape ``(3,)`` [m, m, rad].
            held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
            guess: Controls to start from, shape ``(N + 1, 2)`` [rad/s].
            horizon: Their horizon.
            iterations: How many, at most; without, as many as at a control step.
            moving: What moves, from the pose on.
            near: Progress of a place near the pose, not a number where none is known [m].
        """
        rules = self._rules if iterations is None else self._rules._replace(iterations=iterations)
        if not self._compiled:
            return self._back_end.improve(
                pose, held, guess, horizon, iterations=rules.iterations, moving=moving, near=near
            )
        steps = len(horizon.durations)
        if steps >= len(self._room.lower):
            self._enter_room(steps)
        room, begun = self._room, self._horizon
        over = len(room.lower) if begun is None else steps_over(begun, horizon)
        self._horizon = horizon
        room.at.U[: steps + 1] = guess
        data = self._data(pose, held, guess, horizon, moving, near)
        self._improve(data, self._packed, steps, over, rules)
        counts = room.counts.tolist()
        if counts[OUTCOME] in _WANTING:
            return self._back_end.improve(
                pose, held, guess, horizon, iterations=rules.iterations, moving=moving, near=near
            )
        return _summary(room, horizon, counts)

    def _data(
        self,
        pose: Array,
        held: Array,
        guess: Array,
        horizon: Horizon,
        moving: MovingDiscs = NOTHING_MOVES,
        near: float = math.nan,
    ) -> GuidanceData | ControlRateData:
        task, durations = self._task, horizon.durations
        pose = np.ascontiguousarray(pose, dtype=np.float64)
        space = task.space(guess, durations, pose, moving)
        if space is not self._space:
            robot, hessian = task.settings.model, task.settings.solver.hessian
            self._space = space
            self._given = guidance_data(
                robot, space, task.cost, pose, task.goal, durations, hessian, task.heading
            )
        data, rate = begun_at(self._given, pose, durations, near), self._rate
        if rate > 0.0:
            return ControlRateData(data, rate, np.ascontiguousarray(held, dtype=np.float64))
        return data

    def _enter_room(self, steps: int) -> None:
        """Use room for so many steps at least; nothing is known of a last plan there."""
        outputs = self._task.outputs
        if outputs not in self._rooms or steps >= len(self._rooms[outputs][1].lower):
            self._rooms[outputs] = self._make_room(steps)
        self._packed, self._room = self._rooms[outputs]
        self.forget()

    def _make_room(self, steps: int) -> tuple[Packed, Workspace]:
        task = self._task
        settings = task.settings
        states = 5 if settings.weights.control_rate > 0.0 else 3
        size = Dimensions(steps, states, 2, task.outputs, len(task.penalty_path))
        trust_radius = np.full(states, math.inf)
        trust_radius[2] = task.heading_trust_region
        room = workspace(size, task.penalty_terminal, task.penalty_path, trust_radius)
        room.upper[:] = settings.robot.max_wheel_speed
        room.lower[:] = -room.upper
        return pack(room)

    def _make_rules(self) -> None:
        task = self._task
        target = target_of(task.goal, task.heading, task.outputs)
        default = Options(task.penalty_terminal, task.penalty_path)
        self._rules = Rules(
            iterations=task.settings.solver.iterations_per_step,
            line_search=default.line_search,
            output_tolerance=default.output_tolerance * (float(np.linalg.norm(target)) or 1.0),
            control_tolerance=default.control_tolerance,
            violation_tolerance=default.violation_tolerance,
            slack_tolerance=SLACK_TOLERANCE,
            growth_limit=default.growth_limit,
        )


def _longest(settings: GuidanceSettings) -> Horizon:
    """The longest horizon, which is the first."""
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    return remaining(0, period, final)


def _summary(room: Workspace, horizon: Horizon, counts: list[int]) -> Improvement:
    stages, solved = len(horizon.edges), counts[OUTCOME] == SOLVED
    largest, left, path = 0.0, [], 0
    if solved and counts[RELAXED]:
        # Of a handful of numbers Python's own lists are looked through sooner.
        slack = room.slack.tolist()
        largest, path = max(slack), len(slack) - len(room.at.output_error)
        left = [index for index, each in enumerate(slack) if each > SLACK_TOLERANCE]
    return Improvement(
        Plan(horizon, room.at.U[:stages].copy(), room.at.X[:stages, :3].copy()),
        solved,
        bool(left),
        largest,
        tuple([index for index in left if index < path]),
        bool(left) and left[-1] >= path,
        counts[DONE],
        counts[QP_ITERATIONS],
        counts[ACTIVE_ROWS],
        _REASONS.get(counts[OUTCOME], QPStatus.FAILED.value),
    )
