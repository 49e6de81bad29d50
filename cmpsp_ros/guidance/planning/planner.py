"""The planner: poses the problem of a control step, and improves a plan by C-MPSP iterations."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation import ocp_functions
from cmpsp_ros.guidance.formulation.guidance_problem import begun_at, guidance_data, target_of
from cmpsp_ros.guidance.formulation.ocp_formulation import (
    OcpFormulation,
    terminal_constraint,
    terminal_penalty,
)
from cmpsp_ros.guidance.formulation.ocp_functions import WHEEL_ROUNDING, GuidanceData
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.horizon import Horizon, remaining, steps_over, to_nanoseconds
from cmpsp_ros.guidance.planning.candidate import SolveResult
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.solver_settings import UNLIMITED
from cmpsp_ros.mpsp import SLACK_TOLERANCE, Dimensions, Options
from cmpsp_ros.mpsp.models import CONTROL_RATE, ControlRateData
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPStatus
from cmpsp_ros.mpsp.qp.riccati import INFEASIBLE, ITERATION_LIMIT, NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.sqp import Driver, Functions
from cmpsp_ros.robots import Robot, within_ramp
from cmpsp_ros.world import FreeSpace

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
    """Improves control histories.

    One for every plan that is improved side by side with others. It keeps memory for the longest
    horizon, and the active constraints of its last plan to warm-start the next one; they change
    the way to the solution of a subproblem, not the solution.
    """

    def __init__(self, formulation: OcpFormulation) -> None:
        """Take what all plans have in common; several planners may share it."""
        self._formulation = formulation
        settings = formulation.settings
        solver = settings.solver
        self._compiled = solver.qp == RICCATI_ACTIVE_SET and solver.hessian != 'exact'
        self._rate, self._max_change = settings.weights.control_rate, settings.max_wheel_change
        self._known: tuple[FreeSpace, Target, Robot] | None = None
        self._given: GuidanceData
        self._horizon: Horizon | None = None
        # Addresses of the functions that `CONTROL_RATE` calls.
        self._inner: IntArray | None = None
        period = to_nanoseconds(settings.control_period)
        longest = remaining(0, period, to_nanoseconds(settings.longest_horizon))
        # By the number of outputs, and kept for when that is asked for again; the second are for
        # what the compiled solver cannot do.
        self._drivers: dict[int, Driver] = {}
        self._others: dict[int, Driver] = {}
        self._target = settings.target
        self._use_driver(len(longest.durations))
        nothing = np.zeros((len(longest.edges), settings.robot.n_controls))
        context = PlanningContext.at_pose(settings, formulation.world, np.zeros(3), longest)
        data = self._data(context, nothing)
        if isinstance(data, ControlRateData):
            self._inner = FUNCTIONS.addresses(data.inner, self._ws)
            data = data._replace(functions=self._inner)
        functions = CONTROL_RATE if formulation.remembers_control else FUNCTIONS
        self._functions = functions.entries(data, self._ws)

    def forget(self) -> None:
        """Begin the next plan without the active rows of the last one."""
        self._horizon = None
        self._driver.forget()

    def improve(
        self,
        context: PlanningContext,
        guess: Array,
        iterations: int | None = None,
        work_limit: int = UNLIMITED,
    ) -> SolveResult:
        """Run iterations.

        Args:
            context: What the plan is for.
            guess: Controls to start from, shape ``(N + 1, r)``.
            iterations: How many, at most; without, as many as at a control step.
            work_limit: Visits of a stage after which a subproblem is given up.
        """
        limit = iterations or self._formulation.settings.solver.iterations_per_step
        horizon, steps = context.horizon, len(context.horizon.durations)
        if context.target != self._target or steps >= len(self._ws.lower):
            self._target = context.target
            self._use_driver(steps)
        begun, self._horizon = self._horizon, horizon
        over = 0 if begun is None else steps_over(begun, horizon)
        durations, previous = horizon.durations, context.start.previous_control
        robot = context.start.robot
        if robot.limit_rows:
            guess = robot.all_limited(guess, WHEEL_ROUNDING)
        guess = within_ramp(guess, durations, previous, self._max_change, robot.time_scaling)
        self._ws.trial.U[: steps + 1] = guess
        self._limit[0], self._work_limit[0] = limit, work_limit
        self._bound_speeds(self._driver, context)
        data = self._data(context, guess)
        self._driver.improve(self._functions, data, steps, over)
        outcome = self._counters[0].item()
        if self._compiled and outcome in (NO_CURVATURE, ITERATION_LIMIT):
            work = self._counters[-1].item() + _WORK_OF_BACK_END * limit * (steps + 1)
            if outcome == NO_CURVATURE or work <= work_limit:
                return self._improve_otherwise(guess, context, data, limit)._replace(work=work)
        return _summary(self._driver, self._counters, horizon)

    def _improve_otherwise(
        self,
        guess: Array,
        context: PlanningContext,
        data: GuidanceData | ControlRateData,
        limit: int,
    ) -> SolveResult:
        """Do by the QP back ends what the compiled solver cannot: they can add curvature."""
        horizon = context.horizon
        steps, outputs = len(horizon.durations), terminal_constraint(self._target)
        other = self._others.get(outputs)
        if other is None or steps >= len(other.ws.lower):
            other = self._make_driver(len(self._ws.lower) - 1, outputs, by_name=True)
            self._others[outputs] = other
        self._set_tolerances(other)
        self._bound_speeds(other, context)
        other.ws.trial.U[: steps + 1] = guess
        other.ws.run['max_iterations'] = limit
        other.improve(self._functions, data, steps, 0)
        return _summary(other, _counters(other), horizon)

    def _data(self, context: PlanningContext, guess: Array) -> GuidanceData | ControlRateData:
        pose, robot, world, moving, progress, previous = context.start
        formulation, target = self._formulation, context.target
        durations = context.horizon.durations
        pose = np.ascontiguousarray(pose, dtype=np.float64)
        space = formulation.space(world, guess, durations, target, pose, moving)
        known = self._known
        if known is None or space is not known[0] or target != known[1] or robot is not known[2]:
            self._known = space, target, robot
            goal, heading = _goal_of(target)
            self._given = guidance_data(
                robot,
                space,
                formulation.cost,
                pose,
                goal,
                durations,
                formulation.settings.solver.hessian,
                heading,
            )
        data = begun_at(self._given, pose, durations, progress)
        if formulation.remembers_control:
            previous = np.ascontiguousarray(previous, dtype=np.float64)
            return ControlRateData(
                data,
                len(durations),
                self._rate,
                previous,
                self._max_change,
                robot.rate_limits,
                self._inner,
            )
        return data

    def _use_driver(self, steps: int) -> None:
        """Use memory for so many steps at least; in a new one no last plan is known."""
        outputs = terminal_constraint(self._target)
        known = self._drivers.get(outputs)
        if known is None or steps >= len(known.ws.lower):
            known = self._make_driver(steps, outputs, by_name=not self._compiled)
            self._drivers[outputs] = known
        changed = known is not getattr(self, '_driver', None)
        self._driver, self._ws = known, known.ws
        self._limit = known.ws.run['max_iterations']
        self._work_limit = known.ws.program.head['work_limit']
        self._counters = _counters(known)
        self._set_tolerances(known)
        if changed:
            self.forget()

    def _make_driver(self, steps: int, outputs: int, *, by_name: bool) -> Driver:
        formulation = self._formulation
        settings = formulation.settings
        controls = settings.robot.n_controls
        states = 3 + controls if formulation.remembers_control else 3
        penalty_path = formulation.penalty_path
        size = Dimensions(steps, states, controls, outputs, len(penalty_path))
        trust_radius = np.full(states, math.inf)
        trust_radius[2] = formulation.heading_trust_region
        back_end = (settings.solver.qp, settings.solver.hessian) if by_name else None
        penalty_terminal = terminal_penalty(outputs)
        driver = Driver(size, penalty_terminal, penalty_path, trust_radius, back_end, exact=True)
        driver.ws.upper[:] = settings.robot.bounds
        driver.ws.lower[:] = -driver.ws.upper
        return driver

    def _bound_speeds(self, driver: Driver, context: PlanningContext) -> None:
        """Have a car come to the end slowly enough, braking as it can from where it begins."""
        robot, ws = context.start.robot, driver.ws
        if robot.steering_limits is None:
            return
        durations = context.horizon.durations
        ws.upper[:, 0], ws.lower[:, 0] = robot.bounds[0], -robot.bounds[0]
        if context.end_speed == math.inf:
            return
        left = durations.sum() - np.cumsum(durations)
        slowest = robot.speeds_of(context.start.previous_control).item()
        braked = abs(slowest) - self._max_change * np.arange(1, len(durations) + 1)
        slow = (context.end_speed + robot.max_acceleration * left) / robot.wheel_radius
        ws.upper[: len(durations), 0] = np.clip(np.maximum(slow, braked), 0.0, robot.bounds[0])
        ws.lower[:, 0] = -ws.upper[:, 0]

    def _set_tolerances(self, driver: Driver) -> None:
        run, outputs = driver.ws.run, terminal_constraint(self._target)
        target = target_of(*_goal_of(self._target), outputs)
        default = Options(terminal_penalty(outputs), self._formulation.penalty_path)
        run['line_search'] = default.line_search
        run['output_tolerance'] = default.output_tolerance * (float(np.linalg.norm(target)) or 1.0)
        run['control_tolerance'] = default.control_tolerance
        run['violation_tolerance'] = default.violation_tolerance
        run['slack_tolerance'] = SLACK_TOLERANCE
        run['growth_limit'] = default.growth_limit


def _goal_of(target: Target) -> tuple[Array, float]:
    """Goal, shape ``(2,)`` [m], and heading, NaN for any [rad]."""
    heading = math.nan if target.heading is None else target.heading
    return np.array(target.position, dtype=float), heading


def _counters(driver: Driver) -> tuple[IntArray, ...]:
    """Outcome, relaxation level, iterations, active rows, solver iterations and work, as views."""
    run, head = driver.ws.run, driver.ws.program.head
    results = (run[name] for name in ('outcome', 'level', 'iterations', 'active_rows'))
    return (*results, head['iterations'], head['work'])


def _summary(driver: Driver, counters: tuple[IntArray, ...], horizon: Horizon) -> SolveResult:
    ws, back_end, stages = driver.ws, driver.back_end, len(horizon.edges)
    outcome, level, iterations, active_rows, qp_iterations, work = [
        each.item() for each in counters
    ]
    largest, left, path = 0.0, [], 0
    if outcome == SOLVED and level > 0:
        # A handful of numbers is searched faster in a Python list.
        slack = ws.slack.tolist()
        largest, path = max(slack), len(slack) - len(ws.now.output_error)
        left = [index for index, each in enumerate(slack) if each > SLACK_TOLERANCE]
    if back_end is None:
        reason = _WORK_USED_UP if outcome == ITERATION_LIMIT else _STATUS[outcome].value
    else:
        qp_iterations = back_end.solution.iterations
        reason = back_end.solution.status.value
    return SolveResult(
        Plan(horizon, ws.now.U[:stages].copy(), ws.now.X[:stages, :3].copy()),
        outcome == SOLVED,
        bool(left),
        largest,
        tuple([index for index in left if index < path]),
        bool(left) and left[-1] >= path,
        iterations,
        qp_iterations,
        active_rows,
        reason,
        work,
    )
