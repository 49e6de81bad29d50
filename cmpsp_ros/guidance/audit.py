"""The check before any command leaves, which does not trust the solver or share its code."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.mpsp.compiled import allocation_free
from cmpsp_ros.robot.arcs import arc_from, reach_of
from cmpsp_ros.robot.clear_space import ClearSpace

Array = NDArray[np.float64]

# With `safety.between_samples` off only the samples are held clear, and an active constraint is
# met there to the accuracy of a linearisation.
_SAMPLE_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Verdict:
    """Outcome of an audit.

    Attributes:
        passed: Whether the first command may be sent.
        reason: What is wrong, in words; empty when passed.
        margin: Least clearance over the first control period [m].
        worst_margin: Least clearance over the whole plan [m].
        nearest: What the whole plan comes nearest to.
    """

    passed: bool
    reason: str
    margin: float
    worst_margin: float
    nearest: str


class Audit:
    """Checks plans: finite, within the wheel limits, first control period swept."""

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take limits, road and obstacles from the settings."""
        self._robot = settings.robot
        self._between = settings.safety.between_samples
        self._space = ClearSpace.of(settings.road, settings.obstacles, settings.robot_radius)
        self._names = (
            'the outer road edge',
            'the inner road edge',
            *(f'obstacle {obstacle.name}' for obstacle in settings.obstacles),
        )

    def check(self, pose: Array, controls: Array, durations: Array) -> Verdict:
        """Roll a plan out afresh and say whether its first command may be sent.

        A robot that is already outside the road, or inside an obstacle, may only be commanded not
        to get deeper.

        Args:
            pose: Measured pose, shape ``(3,)`` [m, m, rad].
            controls: Wheel speeds ``(N + 1, 2)`` [rad/s].
            durations: Length of every step, shape ``(N,)`` [s].
        """
        if not np.isfinite(controls).all():
            return _refused('The plan has a wheel speed that is not a finite number.')
        fastest = float(np.abs(controls).max())
        if fastest > self._robot.max_wheel_speed:
            return _refused(
                f'The plan has a wheel speed of {fastest!r} rad/s, the limit is'
                f' {self._robot.max_wheel_speed!r} rad/s.'
            )
        coming, worst = self._clearance(pose, controls, durations)
        if not (np.isfinite(coming).all() and np.isfinite(worst).all()):
            return _refused('The path of the plan is not finite.')
        floor = np.minimum(self.at(pose), 0.0) - (0.0 if self._between else _SAMPLE_TOLERANCE)
        nearest = self._names[int(worst.argmin())]
        short = coming - floor
        reason = ''
        if short.min() < 0.0:
            where = int(short.argmin())
            reason = (
                f'The next {durations[0]:.3g} s would come {-coming[where]:.3g} m too close'
                f' to {self._names[where]}.'
            )
        return Verdict(not reason, reason, float(coming.min()), float(worst.min()), nearest)

    def at(self, pose: Array) -> Array:
        """Clearance of a pose from outer edge, inner edge and obstacles, ``(2 + M,)`` [m]."""
        distance = np.linalg.norm(self._space.centers - pose[:2], axis=1)[None]
        return np.asarray(self._space.clearance(distance, distance)[0])

    def names(self, constraints: Sequence[int]) -> str:
        """Names of path constraints by their index, for messages."""
        return ', '.join(self._names[index] for index in constraints)

    def _clearance(self, pose: Array, controls: Array, durations: Array) -> tuple[Array, Array]:
        """Clearance from each thing over the first step and over all, ``(2 + M,)`` each [m]."""
        robot, space = self._robot, self._space
        coming, worst = np.empty(len(self._names)), np.empty(len(self._names))
        _sweep(
            coming,
            worst,
            pose,
            controls,
            durations,
            robot.wheel_radius,
            robot.half_track,
            self._between,
            space.centers,
            float(space.inner),
            float(space.outer),
            space.radii,
        )
        return coming, worst


@allocation_free
def _sweep(
    coming: Array,
    worst: Array,
    pose: Array,
    controls: Array,
    durations: Array,
    wheel_radius: float,
    half_track: float,
    between: bool,
    centers: Array,
    inner: float,
    outer: float,
    radii: Array,
) -> None:
    """Drive a plan arc by arc and keep the least clearances."""
    x, y, heading = pose[0], pose[1], pose[2]
    for k in range(durations.shape[0]):
        right, left = controls[k, 0] * wheel_radius, controls[k, 1] * wheel_radius
        length = (right + left) / 2.0 * durations[k]
        turn = (right - left) / (2.0 * half_track) * durations[k]
        arc = arc_from(x, y, heading, length, turn)
        x, y, heading = arc.end_x, arc.end_y, heading + turn
        for j in range(centers.shape[0]):
            if between:
                least, greatest = reach_of(arc, centers[j, 0], centers[j, 1])
            else:
                least = greatest = math.hypot(x - centers[j, 0], y - centers[j, 1])
            if j == 0:
                _note(coming, worst, k, 0, outer - greatest)
                _note(coming, worst, k, 1, least - inner)
            else:
                _note(coming, worst, k, j + 1, least - radii[j - 1])


@allocation_free
def _note(coming: Array, worst: Array, k: int, what: int, clearance: float) -> None:
    if k == 0:
        coming[what] = worst[what] = clearance
    # A number that is not one comes in, and nothing replaces it.
    elif clearance < worst[what] or math.isnan(clearance):
        worst[what] = clearance


def _refused(reason: str) -> Verdict:
    return Verdict(False, reason, -np.inf, -np.inf, 'nothing')
