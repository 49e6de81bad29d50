"""Independent reference: the same problem as a nonlinear program, solved by IPOPT through CasADi.

It shares no code with the method, the model or the guidance law, so a fault there cannot recur
here. CasADi is imported only when it is used.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.formulation.constraint_tightening import goal_space, sample_space
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.studies.errors import StudyError
from cmpsp_ros.studies.paper.drives import Path
from cmpsp_ros.studies.paper.judge_space import JudgeSpace

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Judgement:
    """Result of IPOPT.

    Attributes:
        feasible: Whether it ended at a point that satisfies every constraint.
        status: IPOPT's status.
        cost: First term of (95) there.
        wheel_speeds: Shape ``(N, 2)`` [rad/s].
    """

    feasible: bool
    status: str
    cost: float
    wheel_speeds: Array


def judge(settings: GuidanceSettings, pose: Array, start: Path) -> Judgement:
    """Minimise the first term of (95) over the whole horizon at once.

    Args:
        settings: The problem; with `safety.between_samples` in the shrunk space that keeps the
            path between samples clear.
        pose: Where the robot starts, shape ``(3,)`` [m, m, rad].
        start: A path to start from; it decides on which side obstacles are passed.

    Raises:
        StudyError: CasADi is not installed.
    """
    try:
        import casadi  # noqa: PLC0415 (only the judge needs it)
    except ImportError as error:
        raise StudyError(
            'casadi: not installed, wanted for the judge; pip install casadi'
        ) from error
    steps = round(settings.final_time / settings.control_period)
    robot, space = settings.robot, sample_space(settings)
    end = goal_space(settings, settings.target) or space
    opti = casadi.Opti()
    U, X = opti.variable(2, steps), opti.variable(3, steps + 1)
    opti.subject_to(X[:, 0] == pose)
    kept_to = JudgeSpace(casadi, opti, settings, start)
    cost: Any = kept_to.off_center(X[:2, 0], 0, space) ** 2
    for k in range(steps):
        length = (U[0, k] + U[1, k]) * robot.wheel_radius / 2.0 * settings.control_period
        turn = (U[0, k] - U[1, k]) * robot.wheel_radius / (2.0 * robot.half_track)
        half = turn * settings.control_period / 2.0
        # sin(a) / a by its series, exact to rounding for every turn that the wheels allow here.
        square = half * half
        sinc = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72)))
        course = X[2, k] + half
        moved = casadi.vertcat(
            length * sinc * casadi.cos(course), length * sinc * casadi.sin(course), 2.0 * half
        )
        opti.subject_to(X[:, k + 1] == X[:, k] + moved)
        here = end if k + 1 == steps else space
        cost += kept_to.off_center(X[:2, k + 1], k + 1, here) ** 2
        kept_to.keep_clear(X[:2, k + 1], k + 1, here)
    opti.subject_to(X[:2, steps] == np.array(settings.goal))
    if np.isfinite(robot.max_wheel_speed):
        limit = robot.max_wheel_speed
        opti.subject_to(opti.bounded(-limit, casadi.vec(U), limit))
    cost = 0.5 * settings.weights.road_center * cost
    # Without a centre line the least turning of the wheels.
    opti.minimize(cost if settings.road.has_center_line else casadi.sumsqr(U))
    opti.set_initial(U, start.wheel_speeds.T)
    opti.set_initial(X, start.poses.T)
    quiet: dict[str, Any] = {'print_level': 0, 'sb': 'yes', 'max_iter': 500}
    opti.solver('ipopt', {'print_time': False}, quiet)
    # It says by raising that it found nothing; where it got to is still there to be looked at.
    with contextlib.suppress(RuntimeError):
        opti.solve()
    status = opti.return_status()
    return Judgement(
        feasible=status in {'Solve_Succeeded', 'Solved_To_Acceptable_Level'},
        status=status,
        cost=float(opti.debug.value(cost)),
        wheel_speeds=np.asarray(opti.debug.value(U)).T,
    )
