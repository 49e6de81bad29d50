"""Plans: the robot's problem posed from where it is, and improved by C-MPSP iterations."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation import ocp_functions
from cmpsp_ros.guidance.formulation.guidance_problem import (
    begun_at,
    guidance_data,
    target_of,
    with_parameters,
)
from cmpsp_ros.guidance.formulation.ocp_formulation import Task
from cmpsp_ros.guidance.formulation.ocp_functions import GuidanceData
from cmpsp_ros.guidance.horizon import Horizon, remaining, steps_over, to_nanoseconds
from cmpsp_ros.guidance.planning.solve_result import Improvement
from cmpsp_ros.guidance.settings import UNLIMITED, GuidanceSettings
from cmpsp_ros.mpsp.iterate import SLACK_TOLERANCE
from cmpsp_ros.mpsp.models.control_rate import ControlRateData, with_control_rate
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.problem import Dimensions
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPStatus
from cmpsp_ros.mpsp.qp.riccati.outcome import INFEASIBLE, ITERATION_LIMIT, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.sqp.driver import Driver, Functions
from cmpsp_ros.mpsp.sqp.workspace import Workspace
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.obstacles.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]

FUNCTIONS: Final = Functions(ocp_functions.predict, ocp_functions.evaluate, ocp_functions.linearise)
"""The robot's problem, compiled."""

# What an iteration of a QP back end takes at a stage, in visits of a stage.
_WORK_OF_BACK_END: Final = 10_000
_STATUS: Final = {
    SOLVED: QPStatus.SOLVED,
    INFEASIBLE: QPStatus.INFEASIBLE,
    NO_CURVATURE: QPStatus.FAILED,
}
_WORK_USED_UP: Final = 'The work of this control step was used up, or rounding was too large.'


class Planner:
    """Improves control histories for one set of settings.

    One for every plan that is improved side by side with others. It keeps memory for the longest
    horizon, and the active constraints of its last plan for the next one to begin with; they
    change the way to the solution of a subproblem, not the solution.
    """

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take road, obstacles, weights and solver from the settings."""
        self._task = Task(settings)
        solver = settings.solver
        self._compiled = solver.qp == RICCATI_ACTIVE_SET and solver.hessian != 'exact'
        self._rate = settings.weights.control_rate
        self._space: FreeSpace | None = None
        self._given: GuidanceData
        self._horizon: Horizon | None = None
        longest = _longest(settings)
        # By the number of outputs, and kept for when that is asked for again; the second are for
        # what the compiled solver cannot do.
        self._drivers: dict[int, Driver] = {}
        self._others: dict[int, Driver] = {}
        self._use_driver(len(longest.durations))
        nothing = np.zeros((len(longest.edges), 2))
        self._functions = _compiled(self._data(np.zeros(3), nothing[0], nothing, longest), self._ws)

    def aim(self, settings: GuidanceSettings) -> None:
        """Take another goal; nothing else of the settings may differ."""
        task = self._task
        task.aim(settings)
        if self._space is not None:
            self._given = with_parameters(self._given, goal=task.goal, heading=task.heading)
        self._use_driver(len(_longest(settings).durations))

    def forget(self) -> None:
        """Begin the next plan without what is known of the last one."""
        self._horizon = None
        self._driver.forget()

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
        work_limit: int = UNLIMITED,
    ) -> Improvement:
        """Run iterations.

        Args:
            pose: Present pose, shape ``(3,)`` [m, m, rad].
            held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
            guess: Controls to start from, shape ``(N + 1, 2)`` [rad/s].
            horizon: Their horizon.
            iterations: How many, at most; without, as many as at a control step.
            moving: What moves, from the pose on.
            near: Progress of a place near the pose, NaN where none is known [m].
            work_limit: Visits of a stage after which a subproblem is given up.
        """
        most = iterations or self._task.settings.solver.iterations_per_step
        steps = len(horizon.durations)
        if steps >= len(self._ws.lower):
            self._use_driver(steps)
        begun, self._horizon = self._horizon, horizon
        over = 0 if begun is None else steps_over(begun, horizon)
        self._ws.trial.U[: steps + 1] = guess
        self._most[0], self._work_limit[0] = most, work_limit
        data = self._data(pose, held, guess, horizon, moving, near)
        self._driver.improve(self._functions, data, steps, over)
        outcome = self._outcome[0]
        if self._compiled and outcome in (NO_CURVATURE, ITERATION_LIMIT):
            work = int(self._work[0]) + _WORK_OF_BACK_END * most * (steps + 1)
            if outcome == NO_CURVATURE or work <= work_limit:
                return self._improve_otherwise(guess, horizon, data, most)._replace(work=work)
        return _summary(self._driver, horizon)

    def _improve_otherwise(
        self, guess: Array, horizon: Horizon, data: GuidanceData | ControlRateData, most: int
    ) -> Improvement:
        """Do by the QP back ends what the compiled solver cannot: they can add curvature."""
        steps, outputs = len(horizon.durations), self._task.outputs
        other = self._others.get(outputs)
        if other is None or steps >= len(other.ws.lower):
            other = self._others[outputs] = self._make_driver(len(self._ws.lower) - 1, by_name=True)
        self._set_tolerances(other)
        other.ws.trial.U[: steps + 1] = guess
        other.ws.run['max_iterations'] = most
        other.improve(self._functions, data, steps, 0)
        return _summary(other, horizon)

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
            return ControlRateData(
                data, len(durations), rate, np.ascontiguousarray(held, dtype=np.float64)
            )
        return data

    def _use_driver(self, steps: int) -> None:
        """Use memory for so many steps at least; nothing is known of a last plan in a new one."""
        outputs, known = self._task.outputs, self._drivers.get(self._task.outputs)
        if known is None or steps >= len(known.ws.lower):
            known = self._make_driver(steps, by_name=not self._compiled)
            self._drivers[outputs] = known
        changed = known is not getattr(self, '_driver', None)
        self._driver, self._ws = known, known.ws
        self._most, self._outcome = known.ws.run['max_iterations'], known.ws.run['outcome']
        head = known.ws.program.head
        self._work, self._work_limit = head['work'], head['work_limit']
        self._set_tolerances(known)
        if changed:
            self.forget()

    def _make_driver(self, steps: int, *, by_name: bool) -> Driver:
        task = self._task
        settings = task.settings
        states = 5 if settings.weights.control_rate > 0.0 else 3
        size = Dimensions(steps, states, 2, task.outputs, len(task.penalty_path))
        trust_radius = np.full(states, math.inf)
        trust_radius[2] = task.heading_trust_region
        back_end = (settings.solver.qp, settings.solver.hessian) if by_name else None
        driver = Driver(size, task.penalty_terminal, task.penalty_path, trust_radius, back_end)
        driver.ws.upper[:] = settings.robot.max_wheel_speed
        driver.ws.lower[:] = -driver.ws.upper
        return driver

    def _set_tolerances(self, driver: Driver) -> None:
        task, run = self._task, driver.ws.run
        target = target_of(task.goal, task.heading, task.outputs)
        default = Options(task.penalty_terminal, task.penalty_path)
        run['line_search'] = default.line_search
        run['output_tolerance'] = default.output_tolerance * (float(np.linalg.norm(target)) or 1.0)
        run['control_tolerance'] = default.control_tolerance
        run['violation_tolerance'] = default.violation_tolerance
        run['slack_tolerance'] = SLACK_TOLERANCE
        run['growth_limit'] = default.growth_limit


def _longest(settings: GuidanceSettings) -> Horizon:
    """The longest horizon, which is the first."""
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    return remaining(0, period, final)


def _compiled(data: GuidanceData | ControlRateData, ws: Workspace) -> Functions:
    if isinstance(data, ControlRateData):
        return with_control_rate(FUNCTIONS.entries(data.inner, ws))
    return FUNCTIONS.entries(data, ws)


def _summary(driver: Driver, horizon: Horizon) -> Improvement:
    ws, back_end = driver.ws, driver.back_end
    run = ws.run[0]
    stages, outcome = len(horizon.edges), int(run['outcome'])
    largest, left, path = 0.0, [], 0
    if outcome == SOLVED and run['level'] > 0:
        # Of a handful of numbers Python's own lists are looked through sooner.
        slack = ws.slack.tolist()
        largest, path = max(slack), len(slack) - len(ws.now.output_error)
        left = [index for index, each in enumerate(slack) if each > SLACK_TOLERANCE]
    if back_end is None:
        iterations = int(ws.program.head['iterations'][0])
        reason = _WORK_USED_UP if outcome == ITERATION_LIMIT else _STATUS[outcome].value
    else:
        iterations, reason = back_end.solution.iterations, back_end.solution.status.value
    return Improvement(
        Plan(horizon, ws.now.U[:stages].copy(), ws.now.X[:stages, :3].copy()),
        outcome == SOLVED,
        bool(left),
        largest,
        tuple([index for index in left if index < path]),
        bool(left) and left[-1] >= path,
        int(run['iterations']),
        iterations,
        int(run['active_rows']),
        reason,
        int(ws.program.head['work'][0]),
    )
