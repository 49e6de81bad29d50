"""Which goal the law drives to: one after another, one that it is told, or the road without end."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.horizon import NANOSECONDS, to_nanoseconds
from cmpsp_ros.guidance.mission.goals import Goal, line_ahead, way_along
from cmpsp_ros.guidance.mission.return_to_goal import is_away, time_back, turn_rate
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.roads.road import OpenFloor

Array = NDArray[np.float64]

TOLD: Final = 'goal_pose'
"""Name of a goal that the law was told while it drove or stood."""

# Control periods for the shortest way: there must be something to steer with.
_FEWEST: Final = 5
# Beside the robot, for the direction of the road there [m].
_NEAR: Final = 0.01


class Itinerary:
    """The goal of the moment.

    Attributes:
        goal: That goal; None where a road is followed.
        settings: Settings with that goal alone. Its time counts from when the way to it begins.
        final: When to pass it, or how far plans look ahead along a road [ns].
        end: When the last goal is to be passed, or the road to be left [ns].
        is_return: Whether it leads back to a goal that was reached before.
        heard: How many goals were told since the run began.
    """

    goal: Goal | None
    settings: GuidanceSettings
    final: int
    end: int
    is_return: bool
    _without_heading: GuidanceSettings | None

    def __init__(self, settings: GuidanceSettings) -> None:
        """Take the goals from the settings."""
        self._given = settings
        self.reset()

    def reset(self) -> None:
        """Begin again, without what was told."""
        self.heard = 0
        self._waiting: tuple[int, Goal] | None = None
        self._told: Goal | None = None
        self._told_at = self._index = 0
        self._aim()

    def reconfigure(self, settings: GuidanceSettings) -> None:
        """Take new settings, and stay on the way to where it leads."""
        self._given = settings
        self._aim()

    @property
    def is_last(self) -> bool:
        """Whether nothing follows after this goal."""
        return self.goal is not None and self.final == self.end

    @property
    def task(self) -> GuidanceSettings:
        """The settings, with the goal that was told instead of theirs where there is one."""
        return self._given if self._told is None else self._given.towards(self._told)

    def tell(self, stamp: int, goal: Goal) -> None:
        """Take another goal instead of all others, from the first control step that is not older.

        Args:
            stamp: Its time stamp [ns]; 0 for at once.
            goal: The goal; when to pass it is found out then.
        """
        self._waiting = stamp, goal

    def aim(self, steps: int) -> GuidanceSettings:
        """Settings to plan with: one step alone meets no heading beside a point.

        Args:
            steps: How many are left.
        """
        if steps > 1 or self.goal is None or self.goal.heading is None:
            return self.settings
        if self._without_heading is None:
            self._without_heading = replace(self.settings, goal_heading=None)
        return self._without_heading

    def go_on(self, stamp: int, now: int, pose: Array, near: float = math.nan) -> bool:
        """Find the goal of the moment.

        Args:
            stamp: Time stamp of the odometry [ns].
            now: The same since time 0 [ns].
            pose: Where a command that is given now begins to have an effect, shape ``(3,)``.
            near: Progress of a place near it, not a number where none is known [m].

        Returns:
            Whether it is another one than before.
        """
        effect = now + self._delay
        if effect < self.final and self._is_known and self._waiting is None and self.goal:
            return False
        if self._waiting is not None and self._waiting[0] <= stamp:
            goal, self._waiting = self._waiting[1], None
            self._set_out(goal, effect, self._time_to(goal, pose, near))
            return True
        if self._given.follow is not None:
            self._look_ahead(now, pose, near)
            return False
        before = self._index
        while self.final <= effect and not self.is_last:
            self._index += 1
            self._aim()
        if not self._is_known:
            self._pass_along(pose, near)
        if self._index > before:
            return True
        if now >= self.end and self._given.hold and is_away(self.settings, pose):
            assert self.goal is not None  # noqa: S101 (only a road has none)
            self._set_out(self.goal, effect, time_back(self.settings, pose))
            self.is_return = True
            return True
        return False

    def _time_to(self, goal: Goal, pose: Array, near: float) -> float:
        """How long the way to a goal takes, with turns at its beginning and its end [s]."""
        given, (x, y) = self._given, goal.position
        way = way_along(given.road, pose, goal.position, goal.heading, near)
        if isinstance(given.road, OpenFloor):
            begin = end = math.atan2(y - pose[1], x - pose[0])
        else:
            _, begin = line_ahead(given.road, pose, math.copysign(_NEAR, way), near)
            _, end = line_ahead(given.road, pose, way, near)
        turn = abs(math.remainder(begin - pose[2], math.tau))
        if goal.heading is not None:
            turn += abs(math.remainder(goal.heading - end, math.tau))
        return abs(way) / given.pace + turn / turn_rate(given)

    def _set_out(self, goal: Goal, begin: int, seconds: float) -> None:
        """Drive to a goal from now on, to be passed at a control instant."""
        period = to_nanoseconds(self._given.control_period)
        end = -(-(begin + to_nanoseconds(seconds)) // period)
        end = max(end, begin // period + _FEWEST) * period
        self._told = Goal(goal.position, end / NANOSECONDS, goal.heading, goal.name)
        self._told_at = begin
        self._aim()

    def _aim(self) -> None:
        given, self.is_return = self._given, False
        self._delay = to_nanoseconds(given.command_delay)
        self._without_heading = None
        self._is_known = True
        if given.follow is not None:
            self.goal, self.final = None, to_nanoseconds(given.follow.horizon)
            self.end = to_nanoseconds(given.final_time)
            self._look_ahead(0, given.road.middle(), math.nan)
            return
        goals, begin = given.goals, 0.0
        if self._told is not None:
            goals, begin, self._index = (self._told,), self._told_at / NANOSECONDS, 0
        elif self._index:
            begin = goals[self._index - 1].time
        goal = self.goal = goals[self._index]
        drives_on = goal is not goals[-1]
        self.settings = given.towards(goal, begin, drives_on=drives_on) if goal.name else given
        self.final, self.end = to_nanoseconds(goal.time), to_nanoseconds(goals[-1].time)
        no_road = isinstance(given.road, OpenFloor)
        self._is_known = self.is_last or goal.heading is not None or no_road

    def _pass_along(self, pose: Array, near: float) -> None:
        """Have the goal passed along the road: from there the next one can be driven to."""
        goal, road = self.goal, self._given.road
        assert goal is not None  # noqa: S101 (only a road without end has none)
        way = way_along(road, pose, goal.position, near=near)
        _, direction = line_ahead(road, pose, way, near)
        self.goal = replace(goal, heading=direction)
        self.settings = replace(self.settings, goal_heading=direction)
        self._is_known = True

    def _look_ahead(self, now: int, pose: Array, near: float) -> None:
        """Aim at the line across the road that is to be reached at the end of the horizon."""
        follow = self._given.follow
        assert follow is not None  # noqa: S101 (the caller has looked)
        period = to_nanoseconds(self._given.control_period)
        self.final = now // period * period + to_nanoseconds(follow.horizon)
        place, direction = line_ahead(self._given.road, pose, follow.way, near)
        self.settings = self._given.towards(Goal(place, follow.horizon, direction))
