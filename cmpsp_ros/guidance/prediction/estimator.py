"""Estimates before a plan is made: where the robot is, how it responds, and where a plan begins."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.messages.tracks import MovingObject, Track
from cmpsp_ros.guidance.prediction.bystanders import bystanders
from cmpsp_ros.guidance.prediction.obstacle_tracker import (
    ObstacleTracker,
    StandingPeople,
    as_seen,
    reachable_sets,
    within_reach,
)
from cmpsp_ros.guidance.prediction.pending_commands import PendingCommands
from cmpsp_ros.guidance.prediction.response_estimate import ResponseEstimate
from cmpsp_ros.guidance.prediction.slip import SlipEstimate
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import to_nanoseconds
from cmpsp_ros.guidance.world import World
from cmpsp_ros.robots import Robot
from cmpsp_ros.robots.motion import smoothed, within_ramp
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs
from cmpsp_ros.world.roads import project_on_path

AT_REST: Final = np.zeros(2)

_ASTRAY: Final = 0.2  # largest standard deviation of a place in sight that plans take [m]
_NOTHING: Final = np.empty((0, 0)), np.empty(0)  # no controls, without a delay


def as_expected(tracks: Sequence[MovingObject], period: float) -> tuple[MovingObject, ...]:
    """Tracks as plans take them: doubt about a velocity counts until the next control step [s]."""
    expected = list[MovingObject]()
    for each in tracks:
        if isinstance(each, Track) and each.velocity_stddev > 0.0:
            doubt = each.position_stddev + period * each.velocity_stddev
            doubt = min(doubt, _ASTRAY) if each.is_seen else doubt
            each = replace(each, position_stddev=doubt, velocity_stddev=0.0)  # noqa: PLW2901
        expected.append(each)
    return tuple(expected)


class Observation(NamedTuple):
    """Inputs of one control step."""

    stamp: int  # time stamp of the odometry [ns]
    pose: Array  # (x, y, heading) [m, m, rad], finite; the heading may be wrapped
    tracks: tuple[MovingObject, ...] = ()  # latest moving obstacles and robots, each once
    sighting: Sighting | None = None  # grid of the surroundings, if there are sensors


class PlanStart(NamedTuple):
    """The initial state of a plan, and the models that predict it on from there."""

    pose: Array  # ``(3,)`` [m, m, rad]
    robot: Robot  # kinematics, with the slip that is estimated
    world: World
    moving: MovingDiscs = NOTHING_MOVES  # moving obstacles from then on, as plans take them
    progress: float = math.nan  # of a place near the pose, NaN if not needed [m]
    previous_control: Array = AT_REST  # control commanded until then, shape ``(r,)``
    reachable: MovingDiscs = NOTHING_MOVES  # all that they, and people who have stopped, may reach
    among_people: bool = False  # whether anything that moves was seen in this run
    touchable: MovingDiscs = NOTHING_MOVES  # those of `reachable`, as large as they were seen
    previous_change: Array = AT_REST  # its difference from the one before ``(r,)``; 0 after a stop

    def followed(self, settings: LawSettings, controls: Array, durations: Array) -> Array:
        """Controls ``(N + 1, r)``, slowed until the wheels follow; each lasts ``(N,)`` [s]."""
        limits = self.previous_control, settings.max_wheel_change, self.robot.time_scaling
        controls = within_ramp(controls, durations, *limits)
        return self.smoothed(settings, controls)

    def smoothed(self, settings: LawSettings, controls: Array) -> Array:
        """Controls ``(N + 1, r)`` that follow these within the limit of jerk, if there is one."""
        robot, most = self.robot, settings.max_wheel_change
        limits = robot.max_wheel_speed, most, settings.max_second_difference
        if limits[-1] == math.inf:
            return controls
        before = self.previous_control, self.previous_change
        return smoothed(controls, *before, limits, robot.n_speeds)


class Estimate(NamedTuple):
    """The present state, and the one at which a command given now takes effect."""

    here: PlanStart
    start: PlanStart  # the initial state of a plan
    under_way: tuple[Array, Array]  # controls in effect from here to there, and durations [s]
    delay: int  # from a command to its effect, with the lag that is estimated [ns]
    model_changed: bool  # whether the slip is another one now


class Estimator:
    """Slip, response and place of the robot in one run, and the commands under way."""

    def __init__(self, settings: LawSettings) -> None:
        self._slip = SlipEstimate(settings.max_slip)
        self._use(settings)
        self.commands = PendingCommands(self.robot.n_controls)
        self.response, self.tracker = ResponseEstimate(settings), ObstacleTracker()
        self.people, self.among_people = StandingPeople(), False
        # Arc length of the robot along the road, and delay with the lag that is estimated.
        self.progress, self.delay = math.nan, 0
        self.change = self.commands.latest  # `previous_change` of plans that begin now

    def _use(self, settings: LawSettings) -> None:
        """Rebuild the model with the current slip estimate."""
        self._settings = settings
        self.used_slip = min(self._slip.slip, settings.max_slip)
        self.robot = settings.robot.slipping(self.used_slip)

    def reconfigure(self, settings: LawSettings) -> None:
        """Go on with other settings."""
        self._use(settings)
        self.response.reconfigure(settings)

    def update(self, seen: Observation, world: World, previous_control: Array) -> Estimate:
        """Take in an observation, and predict where a command given now takes effect.

        Wheels that lag by ``T`` move as ones that obey at once, so much later.
        """
        stamp, pose, road, known = seen.stamp, seen.pose, world.road, self._settings.tracked
        moving = reachable = touchable = NOTHING_MOVES
        if seen.tracks or self.tracker.ids:
            tracks = within_reach(seen.tracks, pose, self.robot.max_speed)
            expected = as_expected(tracks, self._settings.control_period)
            moving = self.tracker.update(stamp, pose, expected, known)
            reachable = reachable_sets(stamp, tracks, moving, known)
            touchable = as_seen(stamp, tracks, moving, known)
            self.among_people |= any(isinstance(each, Track) for each in seen.tracks)
        if seen.sighting is not None:
            self.people.update(stamp, seen.tracks, seen.sighting, known)
        standing = self.people.standing
        if self.among_people and seen.sighting is not None:
            near = bystanders(stamp, pose, seen.sighting, world, known.max_acceleration)
            standing = (*standing, *near)
        if standing:
            planned = ObstacleTracker().update(stamp, pose, standing, known)
            reachable = reachable.joined(reachable_sets(stamp, standing, planned, known))
            touchable = touchable.joined(as_seen(stamp, standing, planned, known))
        changed = self._end_period(stamp, pose)
        self.progress = project_on_path(road, pose, self.progress)
        here = PlanStart(
            pose,
            self.robot,
            world,
            moving,
            self.progress,
            previous_control,
            reachable,
            self.among_people,
            touchable,
            self.change,
        )
        if not (self.response.delay or self.response.lag):
            self.delay = 0
            return Estimate(here, here, _NOTHING, 0, changed)
        response = self.response.in_use(stamp, self.commands)
        self.delay = self.response.delay + to_nanoseconds(response.lag)
        under_way = controls, durations = response.in_effect()
        if response.lag > 0.0:
            controls = np.vstack([controls, response.settled])
            durations = np.append(durations, response.lag)
        ahead = self.robot.roll_out(pose, controls, durations)[-1]
        progress = project_on_path(road, ahead, self.progress)
        later = float(durations.sum())
        start = here._replace(
            pose=ahead,
            moving=moving.after(later),
            progress=progress,
            reachable=reachable.after(later),
            touchable=touchable.after(later),
        )
        return Estimate(here, start, under_way, self.delay, changed)

    def begin_period(self, seen: Observation, control: Array) -> None:
        """Record how a control period begins: with this command, shape ``(r,)``."""
        if self._settings.max_slip > 0.0:
            ahead, durations = self.commands.until(seen.stamp, self.response.delay)
            speeds = np.array([self.commands.in_force, *ahead, control])
            self._slip.begin(seen.stamp, seen.pose, speeds, durations)

    def _end_period(self, stamp: int, pose: Array) -> bool:
        """Update the estimates at the end of a control period; whether the slip is another one."""
        self.response.update(stamp, pose, self.commands, self.robot, self.used_slip)
        limit = self._settings.max_slip
        if limit > 0.0 and self._slip.end(stamp, pose, self._settings.robot, limit):
            self._use(self._settings)
            return True
        return False

    def lose_period(self) -> None:
        """Leave the present control period out of the estimates: its motion is unknown."""
        self._slip.lose()
        self.response.lose()

    def note_command(self, stamp: int, control: Array, twist: Array, *, stops: bool) -> None:
        """Remember a command ``(r,)`` that answers a stamp [ns], and its twist."""
        self.change = 0.0 * control if stops else control - self.commands.latest
        self.commands.add(stamp, control, twist)

    def take_back(self) -> Array:
        """Forget the last command, which was never sent; the one before it, shape ``(r,)``."""
        latest = self.commands.take_back()
        self.change = 0.0 * latest
        return latest

    def pose_before(self, stamp: int, pose: Array, earlier: int) -> Array:
        """Pose at an earlier time [ns], to which it is driven back by the commands since."""
        speeds, durations = self.commands.since(earlier, stamp, self.response.delay)
        return np.asarray(self.robot.roll_out(pose, speeds, -durations)[-1])
