"""What all plans of one control step have in common."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.horizon import Horizon
from cmpsp_ros.guidance.planning.candidate import Start
from cmpsp_ros.guidance.planning.predicted_encounters import Met, meet
from cmpsp_ros.guidance.settings import GuidanceSettings

Array = NDArray[np.float64]


@dataclass
class Moment:
    """A control step that plans are made for.

    Attributes:
        start: Where they begin.
        held: Wheel speeds commanded until now, shape ``(2,)`` [rad/s].
        horizon: Their horizon.
        plan: The one followed until now, if any.
        settings: All settings of the guidance law.
    """

    start: Start
    held: Array
    horizon: Horizon
    plan: Plan | None
    settings: GuidanceSettings

    @property
    def at_rest(self) -> bool:
        """Whether no plan is under way."""
        return self.plan is None

    @cached_property
    def met(self) -> Met:
        """What moves, where it is met on the way."""
        return meet(self.settings, self.start, self.plan, self.horizon)
