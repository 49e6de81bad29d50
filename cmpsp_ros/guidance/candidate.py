"""What the guidance law chooses from: where a plan can begin, and plans that may be followed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.audit import Verdict
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.improvement import Improvement

Array = NDArray[np.float64]

_CLEARLY_LESS = 0.5


@dataclass(frozen=True)
class Start:
    """Where a plan begins.

    Attributes:
        pose: Where the robot will be when the command decided now takes effect.
        way: Verdict on the way there, under commands given before; None when there is none.
    """

    pose: Array
    way: Verdict | None = None


@dataclass(frozen=True)
class Candidate:
    """A plan that may be followed.

    Attributes:
        improvement: How it was made.
        verdict: On it and on the way to its beginning.
    """

    improvement: Improvement
    verdict: Verdict

    @property
    def plan(self) -> Plan:
        """The plan itself."""
        return self.improvement.plan

    @property
    def usable(self) -> bool:
        """Whether it may be followed at all."""
        return self.improvement.solved and self.verdict.passed

    @property
    def flawless(self) -> bool:
        """Whether it meets every constraint, too."""
        return self.usable and not self.improvement.elastic

    def beats(self, other: Candidate) -> bool:
        """Whether to change over from another plan: only for one that is clearly better."""
        if self.usable != other.usable:
            return self.usable
        if self.improvement.elastic != other.improvement.elastic:
            return other.improvement.elastic
        return self.improvement.slack < _CLEARLY_LESS * other.improvement.slack
