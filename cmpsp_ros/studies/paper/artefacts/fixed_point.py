"""The iteration run to its fixed point, without road and obstacles, as for Fig. 5."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation import N_EDGE_CONSTRAINTS, GuidanceProblem
from cmpsp_ros.mpsp import Options
from cmpsp_ros.mpsp.sqp import CMPSP
from cmpsp_ros.studies.paper.experiments import Experiment
from cmpsp_ros.world import FreeSpace

# Below this distance from the fixed point [rad/s] rounding decides, and ratios mean nothing.
_FLOOR = 1e-8

# Relative tolerances of Sec. 4 so small that only an iteration at rest ends by itself.
_AT_REST = 1e-14


@dataclass(frozen=True)
class Convergence:
    """Iterations from one guess.

    Attributes:
        first_miss: ``|dY_N|`` of the guess itself [m].
        last_miss: The same after all iterations [m].
        controls: Control history of every iteration, stacked, shape ``(I + 1, q)`` [rad/s].
    """

    first_miss: float
    last_miss: float
    controls: Array

    @property
    def errors(self) -> Array:
        """``|U^i - U*|`` with the last iterate for ``U*``, down to rounding [rad/s]."""
        errors: Array = np.linalg.norm(self.controls - self.controls[-1], axis=1)
        above = np.flatnonzero(errors > _FLOOR)
        return errors[: above[-1] + 1] if len(above) else errors[:1]

    @property
    def changes(self) -> Array:
        """``|U^(i+1) - U^i|``, shape ``(I,)`` [rad/s]."""
        changes: Array = np.linalg.norm(np.diff(self.controls, axis=0), axis=1)
        return changes

    @property
    def ratios(self) -> Array:
        """``|U^(i+1) - U*| / |U^i - U*|`` of (60)."""
        errors = self.errors
        return errors[1:] / errors[:-1]

    @property
    def drift(self) -> float:
        """Cosine of the angle between the last two changes: 1 for a straight line."""
        before, last = np.diff(self.controls[-3:], axis=0)
        return float(before @ last / (np.linalg.norm(before) * np.linalg.norm(last)))

    @property
    def converged(self) -> bool:
        """Whether the terminal constraint is met and the controls have come to rest."""
        return self.last_miss < 1e-9 and bool(self.changes[-1] < _FLOOR)


def converge(
    experiment: Experiment,
    guess: tuple[float, float],
    iterations: int,
    *,
    road_center: float,
    full_steps: bool = False,
) -> Convergence:
    """Iterate the constraint-free problem from a constant guess.

    Args:
        experiment: Robot, horizon and start.
        guess: Right and left wheel [rad/s].
        iterations: Iterations at most; one that has come to rest ends.
        road_center: ``q`` of (95); with 0 its second term alone is left.
        full_steps: Whether every step is taken in full, as (43) is written, instead of within the
            law's trust region and as far as its line search allows.
    """
    settings = experiment.settings
    steps = round(settings.final_time / settings.control_period)
    nowhere = FreeSpace.of(settings.road, (), -np.inf)
    problem = GuidanceProblem(
        settings.robot,
        nowhere,
        replace(settings.weights, road_center=road_center, control_effort=0.0),
        np.array(experiment.pose),
        np.array(settings.goal),
        np.full(steps, settings.control_period),
    )
    options = Options(
        penalty_terminal=np.full(2, 1e3),
        penalty_path=np.full(N_EDGE_CONSTRAINTS, 1e3),
        elastic=not full_steps,
        line_search=not full_steps,
        output_tolerance=_AT_REST,
        control_tolerance=_AT_REST,
        trust_radius=(
            None if full_steps else np.array([np.inf, np.inf, settings.solver.heading_trust_region])
        ),
    )
    iteration = CMPSP(problem, options)
    iterate = iteration.init(np.tile(guess, (steps + 1, 1)))
    first = float(np.linalg.norm(iterate.evaluation.output_error))
    controls = [iterate.U.ravel()]
    while len(controls) <= iterations and iteration.terminate(iterate) is None:
        iterate = iteration.step(iterate)
        controls.append(iterate.U.ravel())
    last = float(np.linalg.norm(iterate.evaluation.output_error))
    return Convergence(first, last, np.array(controls))
