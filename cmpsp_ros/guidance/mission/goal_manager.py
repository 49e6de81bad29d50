"""Selection of the present goal: from a list, received on a topic, or along a road without end."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Goal, GoalError, Target
from cmpsp_ros.guidance.mission.return_to_goal import is_away, return_time, turn_rate
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS, to_nanoseconds
from cmpsp_ros.guidance.world import World
from cmpsp_ros.world.roads import Point, arc_length_to, lookahead_point, lookahead_points

# Least control periods on the way to a goal: there must be something to steer with.
_FEWEST: Final = 5
# Lookahead beside the robot, for the direction of the road there [m].
_NEAR: Final = 0.01
_ROUNDING: Final = 1e-9
# Length of the pieces of a road of which the bends are measured [m].
_PIECE: Final = 0.25
# Multiple of the nominal time that is always enough.
_AMPLE: Final = 2
# Part of the time that the path takes with which a goal is put off.
_SCARCE: Final = 0.9
# Part of the arc length within the horizon that a plan leads ahead at least.
_LEAST_AHEAD: Final = 0.5


class GoalManager:
    """The present goal."""

    goal: Goal | None  # None where a road is followed
    target: Target
    final: int  # time to reach it, or the end of the horizon along a road [ns]
    end: int  # time to pass the last goal, or to leave the road [ns]
    is_return: bool  # true if it leads back to a goal that was reached before
    given_up: bool  # true if the run has ended before the goal

    def __init__(self, settings: LawSettings, world: World) -> None:
        self._settings = settings
        self.goals_received = 0
        self._waiting: tuple[int, Goal] | None = None
        self.received: Goal | None = None  # the goal that was received and is driven to
        self._index = self._late = 0
        self._is_timed = not settings.is_soonest
        self._set_goal(world)

    def reconfigure(self, settings: LawSettings, world: World, *, is_other_world: bool) -> None:
        """Take new settings, and keep to the present goal.

        One that was given up is tried again in another world, or with other goals; one that was
        received is not.
        """
        is_same = settings.goals == self._settings.goals and not is_other_world
        stays, at = self.given_up and (is_same or self.received is not None), self.final
        self._settings = settings
        self._set_goal(world)
        if stays:
            self.give_up(at)

    @property
    def next_positions(self) -> list[Point]:
        """Positions of the present goal and of possible next ones (x, y) [m]."""
        goals = [] if self.received else self._settings.goals[self._index + 1 : self._index + 2]
        waiting = [] if self._waiting is None else [self._waiting[1]]
        return [self.target.position, *(each.position for each in (*goals, *waiting))]

    def receive(
        self, stamp: int, goal: Goal, world: World, validator: Validator, latest: int | None
    ) -> None:
        """Take another goal, from a time stamp on [ns]; GoalError if it is refused."""
        self.goals_received += 1
        _check_goal(self._settings, world, validator, goal)
        timeout = to_nanoseconds(self._settings.odom_timeout)
        if latest is not None and stamp - latest > timeout:
            ahead = (stamp - latest) / NANOSECONDS
            raise GoalError(
                f'The goal is {ahead:.3f} s ahead of the last odometry; is use_sim_time right?'
            )
        if (search := world.map_search(self._settings)) is not None:
            search.prepare(goal.position)
        self._waiting = stamp, goal

    def update(self, stamp: int, now: int, start: PlanStart) -> bool:
        """Find the present goal; True if it is another one than before. Times are in [ns]."""
        is_new = self._find(stamp, now, start)
        if not self._is_timed and self.goal is not None:
            self._is_timed = True
            begin = now + self._delay
            needed = to_nanoseconds(self._time_to(self.goal, start))
            self.reach_at((begin + max(needed, _FEWEST * self.period)) // self.period * self.period)
        return is_new

    def _find(self, stamp: int, now: int, start: PlanStart) -> bool:
        effect = now + self._delay
        if effect < self.final and self._is_known and self._waiting is None and self.goal:
            return False
        if self._waiting is not None and self._waiting[0] <= stamp:
            goal, self._waiting = self._waiting[1], None
            self._set_out(goal, effect, self._time_to(goal, start), start.world)
            return True
        if self._settings.follow is not None:
            self._look_ahead(now, start.world, start.pose, start.progress)
            return False
        before = self._index
        while self.final <= effect and not self.is_last:
            self._index += 1
            self._set_goal(start.world)
            if self._settings.is_soonest:
                # The times of those to come are no plan.
                break
        if not self._is_known:
            self._pass_along_road(start)
        if self._index > before:
            self._is_timed = not self._settings.is_soonest
            return True
        settings, target = self._settings, self.target
        may_return = settings.hold and not self.given_up
        if now >= self.end and may_return and is_away(settings, target, start.pose):
            assert self.goal is not None  # noqa: S101 (only a road has none)
            seconds = return_time(settings, target, start.pose)
            self._set_out(self.goal, effect, seconds, start.world)
            self.is_return = True
            return True
        return False

    def reach_at(self, final: int) -> None:
        """Pass the present goal at another time, and all after it as much later or earlier [ns]."""
        assert self.goal is not None  # noqa: S101 (only a road has none)
        if (by := final - self.final) == 0:
            return
        self._late, self.final, self.end = self._late + by, final, self.end + by
        self.goal = replace(self.goal, time=final / NANOSECONDS)

    def latest(self, begin: int, start: PlanStart) -> int:
        """A time by which the present goal can be reached from `begin` at a moderate speed [ns]."""
        assert self.goal is not None  # noqa: S101 (only a road has none)
        # Before the goal it brakes: that takes longer than the way at a moderate speed.
        robot = start.robot
        speed = float(np.linalg.norm(robot.twist(start.previous_control)[:-1]))
        seconds = max(self._time_to(self.goal, start), speed / robot.braking)
        return begin + _AMPLE * max(to_nanoseconds(seconds), _FEWEST * self.period)

    def adapt(self, begin: int, start: PlanStart, *, may_be_later: bool, is_stuck: bool) -> float:
        """Pass the present goal later, and all after it, where the path to it takes too long.

        Where it has become short again, they are passed earlier, but not before they were due.

        Returns by how much later [s], negative for earlier; 0 where the time is enough, no path is
        known, unless the robot is stuck and gets itself out, or it is at the goal. `begin` [ns].
        """
        goal, settings, period = self.goal, self._settings, self.period
        if goal is None or self.given_up or settings.tolerates(*self.target.errors(start.pose)):
            return 0.0
        left, least = self.final - begin, math.dist(start.pose[:2], goal.position) / settings.pace
        may_be_earlier = self._late > 0 and left > _AMPLE * to_nanoseconds(least)
        may_be_earlier = may_be_earlier and not settings.is_soonest
        if not (may_be_later or may_be_earlier):
            return 0.0
        line = self._line(goal, start)
        is_known = line is None or len(line) > 0
        # Who closes the only path now may have gone before long.
        may_be_later = may_be_later and (is_known or is_stuck or bool(start.reachable.names))
        needed = to_nanoseconds(self._time_along(line, goal, start))
        # The earliest arrival that was found is not late where the wheels can keep it.
        quicker = settings.pace / start.robot.max_speed if settings.is_soonest else 1.0
        is_late = may_be_later and left < _SCARCE * quicker * needed
        if not (is_late or (may_be_earlier and is_known and left > _AMPLE * needed)):
            return 0.0
        final = max(-(-(begin + needed) // period), begin // period + _FEWEST) * period
        by = max(0, final - self.final) if is_late else min(max(-self._late, final - self.final), 0)
        self._late += by
        self._set_goal(start.world)
        return by / NANOSECONDS

    def give_up(self, now: int) -> None:
        """End the run before the goal, at `now` [ns], until another goal is received."""
        assert self.goal is not None  # noqa: S101 (only a road without end has none)
        self.goal = replace(self.goal, time=now / NANOSECONDS)
        self.final = self.end = now
        self.is_last = self.given_up = True

    def _line(self, goal: Goal, start: PlanStart) -> Array | None:
        """Line to a goal across a grid, without points where none is known; None without a grid."""
        search = start.world.map_search(self._settings)
        return None if search is None else search.line(start.pose[:2], goal.position, _NEAR)

    def _time_to(self, goal: Goal, start: PlanStart) -> float:
        """Nominal time to a goal, with turns at its beginning and its end [s]."""
        return self._time_along(self._line(goal, start), goal, start)

    def _time_along(self, line: Array | None, goal: Goal, start: PlanStart) -> float:
        settings, (x, y) = self._settings, goal.position
        road, pose, progress = start.world.road, start.pose, start.progress
        length = arc_length_to(road, pose, goal.position, goal.heading, progress)
        if line is not None and len(line) > 1:
            steps = np.diff(line, axis=0)
            length = float(np.hypot(*steps.T).sum())
            begin, end = np.arctan2(steps[[0, -1], 1], steps[[0, -1], 0]).tolist()
        elif not road.has_center_line:
            begin = end = math.atan2(y - pose[1], x - pose[0])
        else:
            _, begin = lookahead_point(road, pose, math.copysign(_NEAR, length), progress)
            _, end = lookahead_point(road, pose, length, progress)
        turn = abs(math.remainder(begin - pose[2], math.tau))
        if goal.heading is not None:
            turn += abs(math.remainder(goal.heading - end, math.tau))
        time = abs(length) / settings.pace
        if settings.robot.lateral_rows and line is None and road.has_center_line:
            time = _time_in_bends(settings, start, goal, length)
        smooth = settings.robot.max_wheel_acceleration / settings.robot.max_wheel_jerk
        return time + turn / turn_rate(settings) + (smooth if math.isfinite(smooth) else 0.0)

    def _set_out(self, goal: Goal, begin: int, seconds: float, world: World) -> None:
        """Drive to a goal from now on, to be passed at a control instant."""
        period, self._late = self.period, 0
        end = -(-(begin + to_nanoseconds(seconds)) // period)
        end = max(end, begin // period + _FEWEST) * period
        self.received = Goal(goal.position, end / NANOSECONDS, goal.heading, goal.name)
        self._set_goal(world)

    def _set_goal(self, world: World) -> None:
        settings, self.is_return, self.given_up = self._settings, False, False
        self._delay = to_nanoseconds(settings.command_delay)
        self.period = to_nanoseconds(settings.control_period)
        self._is_known = True
        if settings.follow is not None:
            self.goal, self.is_last = None, False
            self.end, self.final = to_nanoseconds(settings.final_time), 0
            self._looked_from: Array | None = None
            self._ahead = settings.follow.arc_length
            self._look_ahead(0, world, world.road.middle(), math.nan)
            self._looked_from = None
            return
        goals = settings.goals
        if self.received is not None:
            goals, self._index = (self.received,), 0
        if self._late:
            late = self._late / NANOSECONDS
            goals = tuple(replace(each, time=each.time + late) for each in goals)
        goal = self.goal = goals[self._index]
        self.target = Target(goal.position, goal.heading, drives_on=goal is not goals[-1])
        self.final, self.end = to_nanoseconds(goal.time), to_nanoseconds(goals[-1].time)
        self.is_last = self.final == self.end
        has_line = world.road.has_center_line
        self._is_known = self.is_last or goal.heading is not None or not has_line

    def _pass_along_road(self, start: PlanStart) -> None:
        """Have the goal passed along the road: from there the next one can be driven to."""
        goal, road, pose, progress = self.goal, start.world.road, start.pose, start.progress
        assert goal is not None  # noqa: S101 (only a road without end has none)
        length = arc_length_to(road, pose, goal.position, progress=progress)
        _, direction = lookahead_point(road, pose, length, progress)
        self.goal = replace(goal, heading=direction)
        self.target = self.target._replace(heading=direction)
        self._is_known = True

    def _look_ahead(self, now: int, world: World, pose: Array, progress: float) -> None:
        """Aim at the line across the road that is to be reached at the end of the horizon.

        It moves at most at the speed asked for: else plans that are fast at first would be as good.
        """
        follow = self._settings.follow
        assert follow is not None  # noqa: S101 (the caller has looked)
        before, self.final = self.final, now // self.period * self.period
        self.final += to_nanoseconds(follow.horizon)
        if self._looked_from is not None:
            x, y, heading = self._looked_from.tolist()
            driven = -arc_length_to(world.road, pose, (x, y), heading, progress)
            moved = follow.speed * (self.final - before) / NANOSECONDS
            share = (self._ahead - driven + moved) / follow.arc_length
            self._ahead = min(max(share, _LEAST_AHEAD), 1.0) * follow.arc_length
        self._looked_from = pose
        place, direction = lookahead_point(world.road, pose, self._ahead, progress)
        self.target = Target(place, direction, is_line=True)


def _time_in_bends(settings: LawSettings, start: PlanStart, goal: Goal, length: float) -> float:
    """Nominal time along a centre line, in bends with the limit of lateral acceleration [s]."""
    count = max(math.ceil(abs(length) / _PIECE), 2)
    along, road = np.linspace(0.0, length, count + 1), start.world.road
    points = lookahead_points(road, start.pose, along, goal.position, start.progress)
    steps = np.diff(points, axis=0)
    bends = np.abs(np.gradient(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))))
    # A bend is a curvature times the length of a piece.
    limit = settings.robot.max_lateral_acceleration * abs(length) / count
    speeds = np.minimum(settings.pace, np.sqrt(limit / np.maximum(bends, _ROUNDING)))
    return float((np.hypot(*steps.T) / np.maximum(speeds, _ROUNDING)).sum())


def _check_goal(settings: LawSettings, world: World, validator: Validator, goal: Goal) -> None:
    """GoalError for a goal off the road or in an obstacle, and for any where a road is followed."""
    if settings.follow is not None:
        raise GoalError('The robot follows the road without end (follow.speed): it takes no goal.')
    x, y = goal.position
    away = validator.clearance_at(world, np.array([x, y, math.nan]))
    nearest = int(away.argmin())
    if away[nearest] < -_ROUNDING:
        name = validator.names([nearest], world)
        raise GoalError(f'The goal is {-away[nearest]:.3g} m inside or beyond {name}.')
    beyond = world.road.beyond(goal.position)
    if beyond > _ROUNDING:
        raise GoalError(f'The goal is {beyond:.3g} m beyond the end of the road.')
