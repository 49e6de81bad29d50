"""A guidance law that receives the inputs of a recording."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

from cmpsp_ros.bags.replay.inputs import (
    GoalReceived,
    Halted,
    Input,
    OdometryReceived,
    ParametersChanged,
    RunReset,
    RunStarted,
)
from cmpsp_ros.guidance import Decision, GoalError, GuidanceLaw, GuidanceSettings, Observation
from cmpsp_ros.parameters import Values


class Follower:
    """Feeds inputs to a law, which is created by the first of them."""

    law: GuidanceLaw

    def __init__(self, settings_of: Callable[[Values], GuidanceSettings]) -> None:
        """Wait for the input that creates the law; `settings_of` converts its parameters."""
        self._settings_of = settings_of

    def follow(self, event: Input) -> Decision | None:
        """Process one input; return the resulting decision, if any.

        Raises:
            Exception: Any error of the law on odometry.
        """
        match event:
            case RunStarted(values):
                settings = self._settings_of(values)
                self.law = GuidanceLaw(settings, settings.world)
            case ParametersChanged(values):
                settings = self._settings_of(values)
                self.law.reconfigure(settings, settings.world)
            case RunReset():
                self.law.reset()
            case GoalReceived(stamp, goal):
                # A refusal is counted, as it was then.
                with suppress(GoalError):
                    self.law.set_goal(stamp, goal)
            case Halted(decision):
                names = 'finished', 'cancelled', 'braking'
                flags = {name: getattr(decision, name) for name in names}
                return self.law.halt(decision.stamp, decision.reason, **flags)
            case OdometryReceived(odometry, recorded, tracks=tracks, sighting=sighting):
                observation = Observation(odometry.stamp, odometry.pose, tracks, sighting)
                decided = self.law.step(observation)
                if decided is None:
                    return None
                late = 0.0 if recorded is None or decided.plan is None else recorded.late
                return self.law.after_step(late)
        return None
