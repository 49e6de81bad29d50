"""The robot's problem with costs and limits on the change of its control, compiled."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import IntArray
from cmpsp_ros.guidance.formulation import ocp_functions
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.formulation.ocp_functions import GuidanceData
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.mpsp.models import CONTROL_JERK, CONTROL_RATE, ControlJerkData, ControlRateData
from cmpsp_ros.mpsp.sqp import Driver, Entries, Functions

FUNCTIONS: Final = Functions(ocp_functions.predict, ocp_functions.evaluate, ocp_functions.linearise)
"""The robot's problem without them."""

ProblemData = GuidanceData | ControlRateData


class CompiledProblem(NamedTuple):
    """Machine code for formulations of one kind."""

    kind: tuple[object, ...]
    entries: Entries  # of the problem and the iteration
    # addresses of the functions that `CONTROL_RATE` calls; None without it
    inner: IntArray | None = None
    # addresses of those that `CONTROL_JERK` calls; None without it
    innermost: IntArray | None = None


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
    settings, steps = formulation.settings, len(data.durations)
    previous = np.ascontiguousarray(start.previous_control, dtype=np.float64)
    inner: GuidanceData | ControlJerkData = data
    if formulation.jerk_rows:
        before, wheels = np.stack([previous - start.previous_change, previous]), start.robot.wheels
        functions = None if compiled is None else compiled.innermost
        inner = ControlJerkData(
            data,
            steps,
            before,
            settings.max_second_difference,
            wheels,
            end_jerk,
            formulation.first_jerk_row,
            functions,
        )
    functions = None if compiled is None else compiled.inner
    limits = settings.max_wheel_change, start.robot.rate_limits
    rate = settings.weights.control_rate
    return ControlRateData(inner, steps, rate, previous, *limits, functions)


def compile_problem(
    formulation: OcpFormulation, data: GuidanceData, start: PlanStart, driver: Driver
) -> CompiledProblem:
    """Compile the whole problem for data like these and a driver."""
    kind, ws = formulation.kind, driver.ws
    whole = problem_data(formulation, data, start)
    if not isinstance(whole, ControlRateData):
        return CompiledProblem(kind, FUNCTIONS.entries(whole, ws))
    inner, innermost = FUNCTIONS.addresses(data, ws), None
    if isinstance(whole.inner, ControlJerkData):
        innermost = inner
        jerk = whole.inner._replace(functions=innermost)
        whole, inner = whole._replace(inner=jerk), CONTROL_JERK.addresses(jerk, ws)
    entries = CONTROL_RATE.entries(whole._replace(functions=inner), ws)
    return CompiledProblem(kind, entries, inner, innermost)
