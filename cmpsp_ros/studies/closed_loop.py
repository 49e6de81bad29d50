"""The guidance law driving its own model of the robot, in this process."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import Decision, GuidanceLaw, GuidanceSettings, Observation, to_nanoseconds


def drive(settings: GuidanceSettings, pose: Array) -> Iterator[Decision]:
    """Decide and drive until the final time.

    Args:
        settings: All settings of the law.
        pose: Pose to start from, shape ``(3,)`` [m, m, rad].

    Yields:
        The decision of each control instant, up to and including the one that says that the final
        time has passed.
    """
    law = GuidanceLaw(settings, settings.world)
    period = to_nanoseconds(settings.control_period)
    stamp, finished = 0, False
    while not finished:
        decision = law.step(Observation(stamp, pose))
        if decision is not None:
            yield decision
            law.after_step()
            finished = decision.finished
            held = decision.wheel_speeds[None]
            pose = settings.robot.roll_out(pose, held, np.array([settings.control_period]))[-1]
        stamp += period
