"""The check before any command leaves, which does not trust the solver or share its code."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.robot.arcs import arc_ends, reach
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
        clearance = self._clearance(pose, controls[:-1], durations)
        if not np.isfinite(clearance).all():
            return _refused('The path of the plan is not finite.')
        floor = np.minimum(self.at(pose), 0.0) - (0.0 if self._between else _SAMPLE_TOLERANCE)
        worst = clearance.min(axis=0)
        nearest = self._names[int(worst.argmin())]
        short = clearance[0] - floor
        reason = ''
        if short.min() < 0.0:
            where = int(short.argmin())
            reason = (
                f'The next {durations[0]:.3g} s would come {-clearance[0, where]:.3g} m too close'
                f' to {self._names[where]}.'
            )
        return Verdict(not reason, reason, float(clearance[0].min()), float(worst.min()), nearest)

    def at(self, pose: Array) -> Array:
        """Clearance of a pose from outer edge, inner edge and obstacles, ``(2 + M,)`` [m]."""
        distance = np.linalg.norm(self._space.centers - pose[:2], axis=1)[None]
        return np.asarray(self._space.clearance(distance, distance)[0])

    def names(self, constraints: Sequence[int]) -> str:
        """Names of path constraints by their index, for messages."""
        return ', '.join(self._names[index] for index in constraints)

    def _clearance(self, pose: Array, controls: Array, durations: Array) -> Array:
        twists = self._robot.twist(controls)
        poses = np.empty((len(durations) + 1, 3))
        poses[0] = pose
        turned = np.concatenate([[0.0], np.cumsum(twists[:, 1] * durations)])
        poses[:, 2] = pose[2] + turned
        starts = np.zeros((len(durations), 3))
        starts[:, 2] = poses[:-1, 2]
        legs = arc_ends(starts, twists, durations)[:, :2]
        poses[1:, :2] = pose[:2] + np.cumsum(legs, axis=0)
        if self._between:
            least, greatest = reach(poses[:-1], twists, durations, self._space.centers)
        else:
            offsets = poses[1:, None, :2] - self._space.centers
            least = greatest = np.linalg.norm(offsets, axis=2)
        return self._space.clearance(least, greatest)


def _refused(reason: str) -> Verdict:
    return Verdict(False, reason, -np.inf, -np.inf, 'nothing')
