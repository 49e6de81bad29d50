"""Bounds on the twists that a robot can drive."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class TwistLimits:
    """Bounds on the twists that can be driven: ``|v| + half_track |w| <= speed``.

    Attributes:
        speed: Largest speed, reached when driving straight [m/s].
        turn_rate: Largest turn rate [rad/s].
        half_track: What a turn rate takes from the speed [m]; with wheel limits (94) this is the
            paper's ``L``, by (91), and ``turn_rate`` is ``speed / half_track``. Negative for a
            point of the robot that is the faster the more the robot turns.
    """

    speed: float
    turn_rate: float
    half_track: float = 0.0

    def __post_init__(self) -> None:
        bounds = (self.speed, self.turn_rate, self.half_track)
        if not np.isfinite(bounds).all() or min(bounds[:2]) < 0.0:
            wanted = 'finite numbers, speed and turn rate >= 0'
            raise ValueError(f'twist limits: found {bounds}, wanted {wanted}')

    @property
    def top_speed(self) -> float:
        """Largest speed at any turn rate [m/s]."""
        return max(self.speed, self.speed - self.half_track * self.turn_rate)
