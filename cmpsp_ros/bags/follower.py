"""A guidance law that is told what the one in a recording was told."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from cmpsp_ros.bags.inputs import Began, Changed, Halted, Heard, Input, Reset, Told
from cmpsp_ros.guidance.decision import Decision
from cmpsp_ros.guidance.goals import GoalError
from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.parameters.table import Values


class Follower:
    """Feeds inputs to a law, which begins with the first of them."""

    law: GuidanceLaw

    def __init__(self, settings_of: Callable[[Values], GuidanceSettings]) -> None:
        """Wait for the law to be made.

        Args:
            settings_of: What the law is to be told where these parameters were recorded.
        """
        self._settings_of = settings_of

    def follow(self, told: Input) -> Decision | None:
        """Take one input; the decision on it, if there is one.

        Raises:
            Exception: Whatever the law raises on odometry.
        """
        match told:
            case Began(values):
                self.law = GuidanceLaw(self._settings_of(values))
            case Changed(values):
                self.law.reconfigure(self._settings_of(values))
            case Reset():
                self.law.reset()
            case Told(stamp, goal):
                # A refusal is counted, as it was then.
                with suppress(GoalError):
                    self.law.tell(stamp, goal)
            case Halted(decision):
                return self.law.halt(decision.stamp, decision.reason)
            case Heard(odometry, tracks=tracks):
                return self.law.update(odometry.stamp, odometry.pose, tracks)
        return None
