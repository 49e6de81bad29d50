"""The paper's example (91)-(95) as an optimal control problem, with limits on control changes."""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.guidance.formulation import ocp_functions
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.formulation.ocp_functions import (
    HEADING_SCALE,
    N_EDGE_CONSTRAINTS,
    PARAMETERS,
    CostHessian,
    GuidanceData,
    TerminalConstraint,
)
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.solver_settings import Weights
from cmpsp_ros.mpsp import Dimensions, Evaluation, Hessian, Linearisation, OptimalControlProblem
from cmpsp_ros.mpsp.models import CONTROL_RATE, ControlRateData, Rates
from cmpsp_ros.mpsp.qp.active_set import derivatives_in
from cmpsp_ros.mpsp.qp.riccati import row_type, stage_type
from cmpsp_ros.mpsp.sqp import Driver, Entries, Functions
from cmpsp_ros.robots import Robot
from cmpsp_ros.world import FreeSpace

FUNCTIONS: Final = Functions(ocp_functions.predict, ocp_functions.evaluate, ocp_functions.linearise)
"""The robot's problem without them."""
ProblemData = GuidanceData | ControlRateData


class GuidanceProblem(OptimalControlProblem):
    """Pass the goal at the end of the horizon, inside the road, clear of obstacles.

    States are poses ``(x, y, heading)``; the last control ``U_N`` moves nothing.
    """

    data: GuidanceData

    def __init__(
        self,
        robot: Robot,
        space: FreeSpace,  # of the robot's discs at the samples
        weights: Weights,  # those of rates are not used
        pose: Array,  # ``(3,)`` [m, m, rad]
        goal: Array,  # point to pass at the end ``(2,)`` [m]
        durations: Array,  # of every step ``(N,)`` [s]
        heading: float = math.nan,  # as in `PARAMETERS`, not for a `POINT` [rad]
        outputs: int = TerminalConstraint.POINT,
        progress: float = math.nan,  # as in `GuidanceData` [m]
    ) -> None:
        steps, things = len(durations), N_EDGE_CONSTRAINTS + len(space.first) - 1
        self.size = Dimensions(
            horizon=steps,
            state=3,
            control=robot.n_controls,
            output=outputs,
            path=len(space.discs) * things + robot.limit_rows + robot.lateral_rows,
        )
        self.control_upper = np.tile(robot.bounds, (steps + 1, 1))
        self.control_lower = -self.control_upper
        self.target = target_of(goal, heading, outputs)
        self.data = guidance_data(
            robot, space, weights, pose, goal, durations, heading=heading, progress=progress
        )

    def predict(self, U: Array) -> Array:
        """Exact arcs under zero-order hold; shape ``(N + 1, 3)``."""
        X = np.empty((self.size.horizon + 1, 3))
        ocp_functions.predict(self.data, U, X)
        return X

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Value of (95) without its proximal term, miss and constraint violations."""
        size = self.size
        output_error, g = np.empty(size.output), np.empty((size.horizon + 1, size.path))
        X = np.ascontiguousarray(X)
        cost = ocp_functions.evaluate(self.data, X, U, output_error, g)
        return Evaluation(cost, output_error, g)

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Analytic derivatives; see `ocp_functions.linearise`."""
        N, sizes = self.size.horizon, (self.size.state, self.size.control)
        stages, row = np.zeros(N + 1, stage_type(*sizes)), row_type(*sizes)
        path, terminal = np.zeros((N + 1, self.size.path), row), np.zeros(self.size.output, row)
        data = with_parameters(self.data, hessian=CostHessian[hessian.upper()])
        ocp_functions.linearise(data, np.ascontiguousarray(X), U, stages, path, terminal)
        return derivatives_in(stages, path, terminal, self.size)


def guidance_data(
    robot: Robot,
    space: FreeSpace,
    weights: Weights,
    pose: Array,
    goal: Array,
    durations: Array,
    hessian: Hessian = 'gauss_newton',
    heading: float = math.nan,
    progress: float = math.nan,
) -> GuidanceData:
    """The problem for compiled code; arguments as of `GuidanceProblem`."""
    data = GuidanceData(
        pose=pose,
        progress=float(progress),
        durations=durations,
        parameters=np.zeros(1, PARAMETERS),
        robot=robot.kinematics,
        wheel_rows=robot.limit_rows,
        space=space.data,
    )
    return with_parameters(
        data,
        goal=goal,
        heading=heading,
        road_center=weights.road_center,
        control_change=weights.control_change,
        control_effort=weights.control_effort,
        hessian=CostHessian[hessian.upper()],
    )


def with_parameters(data: GuidanceData, **changes: Any) -> GuidanceData:
    """The same problem with other values of some fields of `PARAMETERS`."""
    parameters = data.parameters.copy()
    for name, value in changes.items():
        parameters[name] = value
    return data._replace(parameters=parameters)


def target_of(goal: Array, heading: float, outputs: int) -> Array:
    """Terminal output ``Y_N*``, shape ``(outputs,)`` [m]; arguments as of `GuidanceProblem`."""
    if outputs == TerminalConstraint.LINE:
        return np.array([math.cos(heading) * goal[0] + math.sin(heading) * goal[1]])
    return np.append(goal, HEADING_SCALE * heading) if outputs == TerminalConstraint.POSE else goal


class CompiledProblem(NamedTuple):
    """Machine code for formulations of one kind."""

    kind: tuple[object, ...]
    entries: Entries  # of the problem and the iteration
    inner: IntArray | None = None  # addresses of functions that `CONTROL_RATE` calls, if it does


def problem_data(
    formulation: OcpFormulation,
    data: GuidanceData,
    start: PlanStart,
    compiled: CompiledProblem | None = None,
    end_jerk: float = math.inf,
) -> ProblemData:
    """Data of the whole problem from a start; of its inner functions only once it is compiled.

    `end_jerk` is the largest second difference of wheel speeds to rest at the end [rad/s].
    """
    if not formulation.remembers_control:
        return data
    settings, robot = formulation.settings, start.robot
    held = np.array(start.previous_control, dtype=np.float64)[None]
    if formulation.jerk_rows:
        held = np.vstack([held - start.previous_change, held])
    rates = Rates(
        len(data.durations),
        settings.weights.control_rate,
        held,
        settings.max_wheel_change,
        robot.rate_limits,
        settings.max_second_difference,
        end_jerk,
        robot.wheels,
    )
    return ControlRateData(data, rates, None if compiled is None else compiled.inner)


def compile_problem(
    formulation: OcpFormulation, data: GuidanceData, start: PlanStart, driver: Driver
) -> CompiledProblem:
    """Compile the whole problem for data like these and a driver."""
    kind, ws = formulation.kind, driver.ws
    whole = problem_data(formulation, data, start)
    if not isinstance(whole, ControlRateData):
        return CompiledProblem(kind, FUNCTIONS.entries(whole, ws))
    inner = FUNCTIONS.addresses(data, ws)
    return CompiledProblem(kind, CONTROL_RATE.entries(whole._replace(functions=inner), ws), inner)
