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
    """Position at the time of a goal [ns]: distance [m] and heading error [rad] or None.

    `ratio` is the larger of both errors, each divided by its tolerance.
    """

    goal: Goal
    stamp: int
    miss: float
    heading_miss: float | None
    ratio: float

    @classmethod
    def of(cls, settings: GuidanceSettings, goal: Goal, stamp: int, pose: Array) -> Passing:
        """Measure it at a pose ``(3,)`` [m, m, rad]."""
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
    """Mean speed along the centre line, negative against its direction [m/s], of close poses."""
    steps = (
        arc_length_to(settings.road, before, tuple(after[:2].tolist()), float(after[2]))
        for before, after in pairwise(poses)
    )
    return sum(steps) / seconds


def goals_driven_to(
    decisions: Sequence[DecisionRecord], settings: GuidanceSettings
) -> list[tuple[int, Goal]]:
    """Each goal with the stamp [ns] from which it was the current one; none on a followed road.

    A decision that names no goal has the only one there is.
    """
    if settings.follow is not None:
        return []
    alone = Goal(settings.goal, settings.final_time, settings.goal_heading)
    same = groupby(decisions, key=lambda each: each.goal or alone)
    return [(next(group).stamp, goal) for goal, group in same]
