"""Which goals a run was to pass, by its parameters and by what it was told under way."""

from __future__ import annotations

from dataclasses import replace
from itertools import zip_longest

from cmpsp_ros.bags.audit.record import Record, Run
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.horizon import NANOSECONDS


def goals_of(record: Record, run: Run) -> list[Goal]:
    """The goals of a run, in order, as they were when they should have been passed.

    Those of the parameters are dropped from when the first goal was told on `goal_pose`, and each
    of these when another was told before its time.
    """
    told = [each for each in record.decisions if run.start <= each.stamp <= run.end]
    told = [each for each in told if each.goal is not None and each.told]
    until = float('inf') if not told else (told[0].stamp - run.start) / NANOSECONDS
    goals = []
    for index, goal in enumerate(record.history.at(run.start).goals):
        then = record.history.at(run.start + round(goal.time * NANOSECONDS)).goals
        if goal.time <= until:
            goals.append(replace(then[index], time=goal.time))
    for each, after in zip_longest(told, told[1:]):
        assert each.goal is not None  # noqa: S101 (looked at above)
        if after is None or after.goal != each.goal:
            end = float('inf') if after is None else (after.stamp - run.start) / NANOSECONDS
            if each.goal.time <= end:
                goals.append(each.goal)
    return goals
