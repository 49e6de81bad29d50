"""Which goal a recorded robot was driving to, and when."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from cmpsp_ros.bags.decisions import Said
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.settings import GuidanceSettings


def aims(decisions: Sequence[Said], settings: GuidanceSettings) -> list[tuple[int, Goal]]:
    """Each goal with the time stamp [ns] from which on it was driven to, in order.

    Args:
        decisions: Of a recording. One that names no goal drives to the only one there is.
        settings: What was in force at first.

    Returns:
        Nothing where a road is followed, or nothing was decided.
    """
    if settings.follow is not None:
        return []
    alone = Goal(settings.goal, settings.final_time, settings.goal_heading)
    same = groupby(decisions, key=lambda each: each.goal or alone)
    return [(next(group).stamp, goal) for goal, group in same]
