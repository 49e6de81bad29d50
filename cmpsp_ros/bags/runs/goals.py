"""Goals: the current one over time, the error at each, and the speed along a followed road."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.guidance import Goal, GuidanceSettings
from cmpsp_ros.world.roads import arc_length_to


@dataclass(frozen=True)
class Passing:
    """The robot's position at the time of a goal.

    Attributes:
        goal: The goal.
        stamp: Its time [ns].
        miss: Distance from it [m].
        heading_miss: Heading error [rad]; None if the goal has no heading.
        ratio: The larger of both errors, each divided by its tolerance.
    """

    goal: Goal
    stamp: int
    miss: float
    heading_miss: float | None
    ratio: float

    @classmethod
    def of(cls, settings: GuidanceSettings, goal: Goal, stamp: int, pose: Array) -> Passing:
        """Measure it.

        Args:
            settings: Where the tolerances are.
            goal: The goal.
            stamp: When it should be passed [ns].
            pose: Where the robot was then, shape ``(3,)`` [m, m, rad].
        """
        miss, off = math.dist(pose[:2], goal.position), None
        ratio = miss / settings.goal_tolerance
        if goal.heading is not None:
            off = abs(math.remainder(float(pose[2]) - goal.heading, math.tau))
            ratio = max(ratio, off / settings.heading_tolerance)
        return cls(goal, stamp, miss, off, ratio)

    def __str__(self) -> str:
        """Both misses in words."""
        where = self.goal.name if self.goal.name not in ('', 'goal') else 'the goal'
        turned = '' if self.heading_miss is None else f' and {self.heading_miss:.3g} rad'
        return f'{self.miss:.3g} m{turned} from {where}'


def mean_speed(settings: GuidanceSettings, poses: Array, seconds: float) -> float:
    """Mean speed along the centre line, negative against its direction [m/s].

    Args:
        settings: With the road.
        poses: Along the path, close together, shape ``(K, 3)`` [m, m, rad].
        seconds: What the path took.
    """
    steps = (
        arc_length_to(settings.road, before, tuple(after[:2].tolist()), float(after[2]))
        for before, after in pairwise(poses)
    )
    return sum(steps) / seconds


def goals_driven_to(
    decisions: Sequence[DecisionRecord], settings: GuidanceSettings
) -> list[tuple[int, Goal]]:
    """Each goal with the time stamp [ns] from which it was the current one, in order.

    Args:
        decisions: Of a recording. One that names no goal has the only one there is.
        settings: Settings in force at first.

    Returns:
        Nothing if a road is followed, or nothing was decided.
    """
    if settings.follow is not None:
        return []
    alone = Goal(settings.goal, settings.final_time, settings.goal_heading)
    same = groupby(decisions, key=lambda each: each.goal or alone)
    return [(next(group).stamp, goal) for goal, group in same]
