"""The planner: poses the problem of a control step, and improves a plan by C-MPSP iterations."""

import math
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.guidance_problem import (
    CompiledProblem,
    ProblemData,
    compile_problem,
    guidance_data,
    problem_data,
    target_of,
)
from cmpsp_ros.guidance.formulation.ocp_formulation import (
    OcpFormulation,
    terminal_constraint,
    terminal_penalty,
)
from cmpsp_ros.guidance.formulation.ocp_functions import LATERAL_PART, WHEEL_ROUNDING, GuidanceData
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.horizon import remaining
from cmpsp_ros.guidance.planning.candidate import SolveResult
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.solver_settings import UNLIMITED
from cmpsp_ros.guidance.times import Horizon, to_nanoseconds
from cmpsp_ros.mpsp import SLACK_TOLERANCE, Dimensions, Options
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPStatus
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp import Driver, Results
from cmpsp_ros.robots import Robot
from cmpsp_ros.world import FreeSpace

_ROUNDED_UP: Final = 1.0 + 1e-9
_WORK_OF_BACK_END: Final = 10_000  # of an iteration at a stage, in visits of a stage
_STATUS: Final[dict[int, QPStatus]] = {
    Outcome.SOLVED: QPStatus.SOLVED,
    Outcome.INFEASIBLE: QPStatus.INFEASIBLE,
    Outcome.NO_CURVATURE: QPStatus.FAILED,
}
_WORK_USED_UP: Final = 'The work of this control step was used up, or rounding was too large.'


class Planner:
    """Improves control histories, and keeps memory and active constraints: a warm start."""

    def __init__(
        self, formulation: OcpFormulation, compiled: CompiledProblem | None = None
    ) -> None:
        """Allocate memory; several planners may share a formulation and machine code."""
        self._formulation = formulation
        settings = formulation.settings
        solver = settings.solver
        self._compiled = solver.qp == RICCATI_ACTIVE_SET and solver.hessian != 'exact'
        self._is_limited = settings.robot.limit_rows > 0
        # Whether the speed at the end of a plan may be limited.
        self._is_bounded = settings.comes_to_rest or settings.robot.steering_limits is not None
        self._period = settings.control_period
        self._max_change, self._jolt = settings.max_wheel_change, settings.max_second_difference
        # The problem, for the space, target and robot that it was made for.
        self._posed: tuple[FreeSpace, Target, Robot] | None = None
        self._problem: GuidanceData
        self._horizon: Horizon | None = None
        self._end_jerk = math.inf
        period = to_nanoseconds(settings.control_period)
        longest = remaining(0, period, to_nanoseconds(settings.longest_horizon))
        # By the number of outputs, kept for reuse; the second are the fallback of the compiled
        # solver.
        self._drivers: dict[int, Driver] = {}
        self._others: dict[int, Driver] = {}
        self._target = settings.target
        self._use_driver(len(longest.durations))
        if compiled is None or compiled.kind != formulation.kind:
            nothing = np.zeros((len(longest.edges), settings.robot.n_controls))
            context = PlanningContext.at_pose(settings, formulation.world, np.zeros(3), longest)
            data = self._data(context, nothing)
            compiled = compile_problem(formulation, data, context.start, self._driver)
        self.compiled = compiled

    def reformulate(self, formulation: OcpFormulation) -> None:
        """Take another formulation with the same layout, and keep memory and warm start."""
        self._formulation, self._posed = formulation, None
        self._is_bounded = self._is_bounded or formulation.settings.comes_to_rest

    def forget(self) -> None:
        """Begin the next plan without the active rows of the last one."""
        self._horizon = None
        self._driver.forget()

    def improve(
        self,
        context: PlanningContext,
        guess: Array,  # ``(N + 1, r)``
        iterations: int | None = None,
        work_limit: int = UNLIMITED,  # visits of a stage after which a subproblem is given up
    ) -> SolveResult:
        """Run iterations from a guess, by default as many as in a control step."""
        limit = iterations or self._formulation.settings.solver.iterations_per_step
        horizon, steps = context.horizon, len(context.horizon.durations)
        target = context.goal if steps > 1 else context.target
        if target != self._target or steps >= len(self._ws.lower):
            self._target = target
            self._use_driver(steps)
        begun, self._horizon = self._horizon, horizon
        over = 0
        if begun is not None:
            over = int(begun.edges.searchsorted(horizon.edges[0], side='right')) - 1
        start, robot = context.start, context.start.robot
        if self._is_limited:
            guess = robot.all_limited(guess, WHEEL_ROUNDING)
        if robot.max_lateral_acceleration < math.inf:
            guess = robot.slowed_in_turns(guess, LATERAL_PART)
        if self._max_change < math.inf:
            guess = start.followed(self._formulation.settings, guess, horizon.durations)
        self._ws.trial.U[: steps + 1] = guess
        self._limits[0][0], self._limits[1][0] = limit, work_limit
        self._end_jerk = math.inf
        if self._is_bounded:
            self._bound_speeds(self._driver, context)
        inner = self._data(context, guess)
        data: ProblemData = inner
        if self._formulation.remembers_control:
            data = problem_data(self._formulation, inner, start, self.compiled, self._end_jerk)
        self._driver.improve(self.compiled.entries, data, steps, over)
        found = self._driver.results
        if self._compiled and found.outcome in (Outcome.NO_CURVATURE, Outcome.ITERATION_LIMIT):
            work = found.work + _WORK_OF_BACK_END * limit * (steps + 1)
            if found.outcome == Outcome.NO_CURVATURE or work <= work_limit:
                return self._improve_by_back_end(guess, context, data, limit)._replace(work=work)
        brakes_late = _ROUNDED_UP * self._jolt < self._end_jerk < math.inf
        return _summary(self._driver, found, context, brakes_late=brakes_late)

    def _improve_by_back_end(
        self, guess: Array, context: PlanningContext, data: ProblemData, limit: int
    ) -> SolveResult:
        """Use a QP back end, which can add curvature, where the compiled solver fails."""
        steps, outputs = len(context.horizon.durations), terminal_constraint(self._target)
        other = self._others.get(outputs)
        if other is None or steps >= len(other.ws.lower):
            other = self._make_driver(len(self._ws.lower) - 1, outputs, by_name=True)
            self._others[outputs] = other
        self._set_tolerances(other)
        if self._is_bounded:
            self._bound_speeds(other, context)
        other.ws.trial.U[: steps + 1] = guess
        other.ws.run['max_iterations'] = limit
        other.improve(self.compiled.entries, data, steps, 0)
        return _summary(other, other.results, context)

    def _data(self, context: PlanningContext, guess: Array) -> GuidanceData:
        pose, robot, world, moving, progress, *_ = context.start
        formulation, target = self._formulation, self._target
        durations = context.horizon.durations
        pose = np.ascontiguousarray(pose, dtype=np.float64)
        space = formulation.space(world, guess, durations, target, pose, moving)
        posed = self._posed
        if posed is None or space is not posed[0] or target != posed[1] or robot is not posed[2]:
            self._posed = space, target, robot
            settings, (goal, heading) = formulation.settings, _goal_of(target)
            weights, hessian = settings.plan_weights, settings.solver.hessian
            self._problem = guidance_data(
                robot, space, weights, pose, goal, durations, hessian, heading
            )
        # `_replace` takes several times as long.
        return GuidanceData(pose, progress, durations, *self._problem[3:])

    def _use_driver(self, steps: int) -> None:
        """Use memory for so many steps at least; a new one has no warm start."""
        outputs = terminal_constraint(self._target)
        known = self._drivers.get(outputs)
        if known is None or steps >= len(known.ws.lower):
            known = self._make_driver(steps, outputs, by_name=not self._compiled)
            self._drivers[outputs] = known
        changed = known is not getattr(self, '_driver', None)
        self._driver, self._ws = known, known.ws
        self._limits = known.ws.run['max_iterations'], known.ws.program.head['work_limit']
        self._set_tolerances(known)
        if changed:
            self.forget()

    def _make_driver(self, steps: int, outputs: int, *, by_name: bool) -> Driver:
        formulation = self._formulation
        settings = formulation.settings
        controls = settings.robot.n_controls
        states = 3 + controls * (formulation.remembers_control + (formulation.jerk_rows > 0))
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
        """Bound the speed of a robot that has to end slowly or at rest, braking in time."""
        robot, ws, change = context.start.robot, driver.ws, self._max_change
        durations, bounds = context.horizon.durations, robot.bounds
        ws.upper[:], ws.lower[:] = bounds, -bounds
        left, steps = durations.sum() - np.cumsum(durations), np.arange(1, len(durations) + 1)
        previous = context.start.previous_control
        if robot.steering_limits is not None:
            rest = robot.wheel_radius * change if context.ends_at_rest else math.inf
            end_speed = min(context.end_speed, rest)
            if end_speed == math.inf:
                return
            braked = abs(robot.speeds_of(previous).item()) - change * steps
            slow = (end_speed + robot.max_acceleration * left) / robot.wheel_radius
            largest = np.clip(np.maximum(slow, braked), 0.0, bounds[0])[:, None]
        elif context.ends_at_rest:
            n = robot.n_speeds
            limits, speeds = robot.rate_limits[:, :n], np.abs(previous[:n])
            fastest = max(float(np.abs(limits @ previous[:n]).max()), change)
            braked = np.outer(np.maximum(1.0 - steps * change / fastest, 0.0), speeds)
            slow = np.outer(1.0 + left / self._period, change / np.abs(limits).max(axis=0))
            largest = np.clip(np.maximum(slow, braked), 0.0, bounds[:n])
        else:
            return
        if self._jolt < math.inf and context.ends_at_rest:
            self._end_jerk, largest = self._less_jerk(context.start, largest)
        ws.upper[: len(durations), : largest.shape[1]] = largest
        ws.lower[:] = -ws.upper

    def _less_jerk(self, start: PlanStart, bounds: Array) -> tuple[float, Array]:
        """Largest jerk to rest, and bounds of speeds ``(N, n)`` that leave time to brake so."""
        n, jolt, last = bounds.shape[1], self._jolt, len(bounds) - 1
        still = np.tile(start.robot.stopped(start.previous_control), (last + 1, 1))
        braked = start.smoothed(self._formulation.settings, still)[:, :n]
        before = np.vstack([start.previous_control[:n], braked])[-2]
        bounds[last] = np.minimum(bounds[last], jolt)
        rest = braked[last], before - 2.0 * braked[last]
        return max(jolt, float(np.abs(rest).max())), np.maximum(bounds, np.abs(braked))

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


def _summary(
    driver: Driver, found: Results, context: PlanningContext, *, brakes_late: bool = False
) -> SolveResult:
    ws, back_end, (start, horizon) = driver.ws, driver.back_end, (context.start, context.horizon)
    outcome, level, iterations, active_rows, qp_iterations, work = found
    stages = len(horizon.edges)
    largest, left, path = 0.0, [], 0
    if outcome == Outcome.SOLVED and level > 0:
        # A handful of numbers is searched faster in a Python list.
        slack = ws.slack.tolist()
        largest, path = max(slack), len(slack) - len(ws.now.output_error)
        left = [index for index, each in enumerate(slack) if each > SLACK_TOLERANCE]
    if back_end is None:
        reason = _WORK_USED_UP if outcome == Outcome.ITERATION_LIMIT else _STATUS[outcome].value
    else:
        qp_iterations, reason = back_end.solution.iterations, back_end.solution.status.value
    controls, poses = ws.now.U[:stages].copy(), ws.now.X[:stages, :3].copy()
    if start.robot.max_lateral_acceleration < math.inf:
        kept = start.robot.slowed_in_turns(controls)
        if kept is not controls:
            controls, poses = kept, start.robot.roll_out(start.pose, kept, horizon.durations)
    return SolveResult(
        plan=Plan(horizon, controls, poses),
        solved=outcome == Outcome.SOLVED,
        elastic=bool(left),
        slack=largest,
        slack_where=tuple([index for index in left if index < path]),
        slack_terminal=bool(left) and left[-1] >= path,
        iterations=iterations,
        qp_iterations=qp_iterations,
        active_rows=active_rows,
        reason=reason,
        work=work,
        brakes_late=brakes_late,
    )
