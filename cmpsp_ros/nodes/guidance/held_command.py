"""The last command of the guidance node: how long it has been held, and how long it may be."""

import math
from collections.abc import Callable
from typing import Final

from cmpsp_ros.guidance import NANOSECONDS, NEVER, GuidanceSettings

# Control periods after a command until which the braking path that was audited with it holds.
_LATEST_RAMP: Final = 1.5


class HeldCommand:
    """Time since the last command, by a clock [ns] that may jump back."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock, self._since = clock, -NEVER

    def begin(self) -> None:
        """Note a command that is given now."""
        self._since = self._clock()

    @property
    def age(self) -> float:
        """Time since the command [s]; negative where the clock has jumped back."""
        return (self._clock() - self._since) / NANOSECONDS

    def left(self, settings: GuidanceSettings) -> float:
        """Time until the next command of a braking path is due [s]; 0 without such paths."""
        age, period = self.age, settings.control_period
        lasts = math.isfinite(settings.robot.max_wheel_acceleration) and 0.0 <= age < period
        return period - age if lasts else 0.0

    def can_brake(self, settings: GuidanceSettings, *, is_lost: bool) -> bool:
        """True if there is a braking path; without a pose, while it is that of the audit."""
        is_limited = math.isfinite(settings.robot.max_wheel_acceleration)
        return is_limited and (not is_lost or self.age <= _LATEST_RAMP * settings.control_period)
