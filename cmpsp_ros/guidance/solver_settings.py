"""How plans are made: weights of the cost, the iteration, and where it begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

SCREENING: Final = 6
"""Initial iterations after which plans are compared."""

UNLIMITED: Final = 1 << 58
"""A limit of work that is never reached."""


@dataclass(frozen=True)
class Weights:
    """Weights of the cost (95) and of two true control costs.

    Attributes:
        road_center: ``q`` of (95), on the squared distance to the centre line [1/m^2].
        control_change: ``R`` of (95), on the change between two iterations [s^2/rad^2]. It
            vanishes at a fixed point: a proximal term, not a control cost.
        control_effort: On the squared wheel speeds [s^2/rad^2].
        control_rate: On the squared change of wheel speeds from one period to the next
            [s^2/rad^2].
    """

    road_center: float = 15.0
    control_change: float = 1.0
    control_effort: float = 0.0
    control_rate: float = 0.0


@dataclass(frozen=True)
class SolverSettings:
    """How the C-MPSP iteration is run at each control step.

    Attributes:
        iterations_per_step: Iterations at each control step (the paper's "iteration unfolding").
        initial_iterations: Iterations without a plan to warm-start from, at rest. Every candidate
            gets `SCREENING` of them; the selected one gets the rest.
        candidates: Number of plans compared at a control step; as many again may turn first.
        qp: Name of the QP back end.
        hessian: Hessian of the cost: Gauss-Newton, exact as it is, or exact and projected to PSD.
        heading_trust_region: Largest predicted heading change of any stage in one iteration [rad];
            0 means none.
        work_rate: Stages that the computer's solver visits in a second [1/s].
        work_share: Fraction of a control period that may be spent on solving; 0 means no limit.
    """

    iterations_per_step: int = 2
    initial_iterations: int = 36
    candidates: int = 4
    qp: str = 'riccati_active_set'
    hessian: Literal['gauss_newton', 'projected', 'exact'] = 'gauss_newton'
    heading_trust_region: float = 0.6
    work_rate: float = 4e7
    work_share: float = 0.04

    def work_limit(self, period: float) -> int:
        """Work that a control step may do, in visits of a stage.

        It is counted, not timed: a replay does just as much.

        Args:
            period: Control period [s].
        """
        return int(self.work_share * self.work_rate * period) or UNLIMITED


@dataclass(frozen=True)
class InitialGuess:
    """Where the first control history comes from.

    Attributes:
        type: ``road`` follows the centre line from wherever the robot stands, ``constant`` holds
            ``wheel_speeds``.
        wheel_speeds: Right and left wheel [rad/s], used by ``constant`` only.
    """

    type: Literal['road', 'constant'] = 'road'
    wheel_speeds: tuple[float, float] = (45.13, 44.63)
