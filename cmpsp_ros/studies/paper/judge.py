"""Independent reference: the same problem as a nonlinear program, solved by IPOPT through CasADi.

It shares no code with the method, the model or the guidance law, so a fault there cannot recur
here. CasADi is imported only when it is used.
"""

from __future__ import annotations

import contextlib
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.guidance.formulation import goal_space, sample_space
from cmpsp_ros.studies.errors import StudyError
from cmpsp_ros.studies.paper.drives import Path
from cmpsp_ros.studies.paper.judge_motion import excess, limit, moved
from cmpsp_ros.studies.paper.judge_space import JudgeSpace


@dataclass(frozen=True)
class Judgement:
    """Result of IPOPT.

    Attributes:
        feasible: Whether it ended at a point that satisfies every constraint.
        status: IPOPT's status.
        cost: First term of (95) there.
        controls: Shape ``(N, r)``, of a differential drive its wheel speeds [rad/s].
        braking: Controls that bring it to rest afterwards, shape ``(K, r)``.
        excess: By how much they are beyond a limit of the robot; 0 or less for not.
    """

    feasible: bool
    status: str
    cost: float
    controls: Array
    braking: Array
    excess: float


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
    robot, space = settings.robot, sample_space(settings, settings.world)
    end = goal_space(settings, settings.world, settings.target) or space
    stopping = _stopping(settings)
    start = _braked(start, steps, stopping)
    opti = casadi.Opti()
    U = opti.variable(robot.n_controls, steps + stopping)
    X = opti.variable(3, steps + stopping + 1)
    opti.subject_to(X[:, 0] == pose)
    kept_to = JudgeSpace(casadi, opti, settings, start)
    cost: Any = kept_to.off_center(X[:2, 0], 0, space) ** 2
    for k in range(steps + stopping):
        step = moved(casadi, robot, X[2, k], U[:, k], settings.control_period)
        opti.subject_to(X[:, k + 1] == X[:, k] + step)
        here = end if k + 1 == steps else space
        off_center = kept_to.off_center(X[:2, k + 1], k + 1, here)
        cost += off_center**2 if k < steps else 0.0
        kept_to.keep_clear(X[:2, k + 1], k + 1, here)
    opti.subject_to(X[:2, steps] == np.array(settings.goal))
    limit(casadi, opti, robot, U, settings.control_period)
    if stopping:
        opti.subject_to(U[: robot.time_scaling.scaled, -1] == 0.0)
    cost = 0.5 * settings.weights.road_center * cost
    # Without a centre line the least turning of the wheels.
    opti.minimize(cost if settings.road.has_center_line else casadi.sumsqr(U))
    opti.set_initial(U, start.controls.T)
    opti.set_initial(X, start.poses.T)
    quiet: dict[str, Any] = {'print_level': 0, 'sb': 'yes', 'max_iter': 500}
    opti.solver('ipopt', {'print_time': False}, quiet)
    # It says by raising that it found nothing; where it got to is still there to be looked at.
    with contextlib.suppress(RuntimeError):
        opti.solve()
    status = opti.return_status()
    found = np.asarray(opti.debug.value(U)).reshape(robot.n_controls, -1).T
    return Judgement(
        feasible=status in {'Solve_Succeeded', 'Solved_To_Acceptable_Level'},
        status=status,
        cost=float(opti.debug.value(cost)),
        controls=found[:steps],
        braking=found[steps:],
        excess=excess(robot, found, settings.control_period),
    )


def _stopping(settings: GuidanceSettings) -> int:
    """Steps in which the robot comes to rest after the final time, from any speed."""
    change = settings.max_wheel_change
    return 0 if change == math.inf else math.ceil(settings.robot.max_wheel_speed / change) + 1


def _braked(start: Path, steps: int, stopping: int) -> Path:
    """A path with so many steps that slow down along its last arc, where it has none yet."""
    missing = steps + stopping - len(start.controls)
    if missing <= 0:
        return start
    robot, period = start.settings.robot, start.settings.control_period
    last = start.controls[-1]
    slower = [robot.slowed(last, 1.0 - k / missing) for k in range(1, missing + 1)]
    poses = robot.roll_out(start.poses[-1], np.array(slower), np.full(missing, period))
    return replace(
        start,
        poses=np.vstack([start.poses, poses[1:]]),
        controls=np.vstack([start.controls, slower]),
    )
