"""The guidance law driving its own model of the robot, in this process."""

from collections.abc import Iterator

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import (
    NANOSECONDS,
    Decision,
    GuidanceLaw,
    GuidanceSettings,
    Observation,
    to_nanoseconds,
)


def drive(settings: GuidanceSettings, pose: Array) -> Iterator[Decision]:
    """Decisions of a drive from a pose ``(3,)``, up to the one after the final time."""
    law = GuidanceLaw(settings, settings.world)
    period = to_nanoseconds(settings.control_period)
    stamp, finished = 0, False
    while not finished:
        held = period
        decision = law.step(Observation(stamp, pose))
        if decision is not None:
            yield decision
            law.after_step()
            finished = decision.finished
            left = to_nanoseconds(decision.time_left)
            held = left if 0 < left < period else period
            speeds, seconds = decision.wheel_speeds[None], np.array([held / NANOSECONDS])
            pose = settings.robot.roll_out(pose, speeds, seconds)[-1]
        stamp += held
