"""State of the guidance law between control steps, grouped by the part that writes it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.messages.tracks import MovingObject
from cmpsp_ros.guidance.mission.feasibility import ClosedRoad
from cmpsp_ros.guidance.mission.goal_manager import GoalManager
from cmpsp_ros.guidance.mission.progress_watch import ProgressWatch
from cmpsp_ros.guidance.planning.arrival_time import ArrivalTime
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.manoeuvre_search import ManoeuvreSearch, needs_manoeuvres
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import Estimator, Observation
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import NOT_SEARCHED, Searched, World
from cmpsp_ros.robots import Robot
from cmpsp_ros.robots.motion import NO_RAMP

# Halvings of the work of a step, at most, and control steps in time after which one is taken back.
_MOST_HALVINGS: Final = 3
_FORGIVEN: Final = 25


@dataclass
class Clock:
    """Time of a run; written by `GuidanceLaw.step`."""

    start: int | None = None  # time stamp of the first odometry [ns]; None before it
    now: int = 0  # time of the last odometry since then [ns]
    due: int = 0  # when the next control step falls due [ns]
    step: int = 0  # control steps so far

    def elapsed(self, stamp: int) -> int:
        """Time from the first odometry to a time stamp [ns]; 0 before it."""
        return 0 if self.start is None else stamp - self.start

    def hold(self, commanded_at: int, period: int) -> None:
        """Decide a `period` [ns] after the time stamp of the command in force [ns]."""
        self.due = self.elapsed(commanded_at) + period

    def interrupt(self) -> None:
        """Decide at once on the next newer odometry."""
        self.due = 0 if self.start is None else self.now + 1


@dataclass
class Lateness:
    """Delays of commands in a run."""

    last: float = 0.0  # duration of the last step if its command came too late, else 0 [s]
    expected: float = 0.0  # longest duration of the late steps not yet forgiven [s]
    late_steps: int = 0  # number of late steps not yet forgiven, as far as they count
    steps_in_time: int = 0  # number of steps in time since the last of them
    halvings: int = 0  # of the work of a step: a single late step may be chance

    def add(self, took: float) -> None:
        """Count a late step that took so long [s]."""
        self.last, self.expected = took, max(self.expected, took)
        self._count(min(self.late_steps + 1, _MOST_HALVINGS + 1))

    def begin_step(self) -> float:
        """Begin the next step; how long the last one took, if it was too late, else 0 [s]."""
        last, self.last = self.last, 0.0
        if last == 0.0 and self.late_steps:
            self.steps_in_time += 1
            if self.steps_in_time >= _FORGIVEN:
                self._count(self.late_steps - 1)
                self.expected = self.expected if self.late_steps else 0.0
        return last

    def _count(self, late_steps: int) -> None:
        self.late_steps, self.steps_in_time = late_steps, 0
        self.halvings = max(late_steps - 1, 0)


@dataclass
class Mission:
    """The way to the goal; written where the task is updated and where a plan is chosen."""

    goals: GoalManager  # the present goal, and those to come
    arrival: ArrivalTime  # search for the earliest time to pass it
    closed_road: ClosedRoad = field(default_factory=ClosedRoad)  # what closes the road to it
    searched: Searched = NOT_SEARCHED  # inputs of the search for the next control step
    idle_steps: int = 0  # steps without progress since a plan could reach the goal
    reaches_goal: bool = True  # true if the last plan reached the goal, and was clear
    final_pose: Array | None = None  # at the final time, ``(3,)`` [m, m, rad]; None before
    warnings: tuple[str, ...] = ()  # tasks that no plan of the run can fulfil, in sentences
    watch: ProgressWatch = field(default_factory=ProgressWatch)  # progress on the way to the goal
    unreachable: str = ''  # why the run has ended before the goal, a sentence; '' if it has not
    manoeuvres: ManoeuvreSearch | None = None  # moves where there is no space to turn

    def search_moves(self, context: PlanningContext) -> str:
        """Without a plan, why to stand while moves are searched for; else the context has them."""
        settings, start, target = context.settings, context.start, context.target
        if start.robot.speeds_of(start.previous_control).any():
            return ''
        if self.manoeuvres is None or not self.manoeuvres.is_for(start, target):
            if not needs_manoeuvres(settings, start, target):
                return ''
            self.manoeuvres = ManoeuvreSearch(settings, start, target)
        context.moves = self.manoeuvres.path
        if self.manoeuvres.is_over:
            return ''
        return 'The robot stands while the moves to the goal are searched: no simple path is clear.'

    def begin_leg(self) -> None:
        """Set out to another goal."""
        self._begin_again()
        self.arrival.sets_out = True
        self.searched = self.searched._replace(hysteresis=NOT_SEARCHED.hysteresis)

    def reconfigure(self, settings: LawSettings, world: World, *, is_other_world: bool) -> None:
        """Go on with other settings; a goal that was given up is begun anew, or stays so."""
        was_given_up, watch, unreachable = self.goals.given_up, self.watch, self.unreachable
        self.goals.reconfigure(settings, world, is_other_world=is_other_world)
        self.arrival.settings = settings
        self._begin_again()
        if self.goals.given_up or not was_given_up:
            self.watch = watch
        if self.goals.given_up:
            self.unreachable = unreachable

    def _begin_again(self) -> None:
        self.idle_steps, self.closed_road = 0, ClosedRoad()
        self.watch, self.unreachable = ProgressWatch(trail=self.watch.trail), ''


@dataclass
class Following:
    """The plan that is followed, and the commands; written by the supervisor."""

    previous_control: Array  # control commanded last, shape ``(r,)``
    commanded_at: int = 0  # time stamp at which this command was given [ns]
    ramp: Array = field(default_factory=lambda: NO_RAMP)  # checked commands to stop it ``(K, r)``
    plan: Plan | None = None  # the plan that is followed, if any
    standby: Plan | None = None  # a plan that is improved while the robot waits
    failures: int = 0  # failed control steps in a row
    end_speed: float = math.inf  # largest speed of a car at the goal; infinite for any [m/s]
    refuge: tuple[float, float] | None = None  # where the robot makes way to, if it does (x, y) [m]
    waited: int = 0  # number of steps for which it has waited there

    def brake(self, stamp: int, period: int, robot: Robot, *, is_due: bool = False) -> None:
        """Give the next command of the ramp, or stop; unless due, once in half a `period` [ns]."""
        if not len(self.ramp):
            self.previous_control = robot.stopped(self.previous_control)
        elif is_due or abs(stamp - self.commanded_at) >= period // 2:
            self.previous_control, self.ramp = self.ramp[0], self.ramp[1:]
        else:
            return
        self.commanded_at = stamp

    def wait(self, standby: Plan | None) -> None:
        """Follow no plan, and improve one for when the way is free."""
        self.plan, self.standby = None, standby


@dataclass
class LawState:
    """One run of the law; a new run begins with a new state."""

    run: int  # number of runs before
    revision: int  # number of changes of settings before
    world: World  # road and static obstacles, with the seen grid
    estimator: Estimator  # slip, response and position of the robot, and pending commands
    mission: Mission  # the way to the goal
    following: Following  # the plan that is followed, and the commands
    sighted: int | None = None  # time stamp of the seen grid [ns]; None without sensors
    clock: Clock = field(default_factory=Clock)  # time of the run
    lateness: Lateness = field(default_factory=Lateness)  # control steps that took too long
    last: tuple[Observation, Decision] | None = None  # observation and decision; None before
    # control step to go on planning for after the command, and its plan: None for the first
    planned: tuple[PlanningContext, Candidate | None] | None = None

    @classmethod
    def begin(cls, settings: LawSettings, world: World, run: int, revision: int) -> LawState:
        """The state before the first odometry of a run."""
        estimator = Estimator(settings)
        following = Following(estimator.robot.at_rest)
        mission = Mission(GoalManager(settings, world), ArrivalTime(settings))
        return cls(run, revision, world, estimator, mission, following)

    def reconfigure(self, settings: LawSettings, world: World) -> None:
        """Continue with other settings, in another world; the seen grid stays."""
        known = self.world
        if world.road != known.road:
            self.estimator.progress = math.nan
        is_other = not world.has_course_of(known)
        if (world.road, world.obstacles) != (known.road, known.obstacles):
            self.world = replace(known, road=world.road, obstacles=world.obstacles)
        self.mission.reconfigure(settings, self.world, is_other_world=is_other)
        self.estimator.reconfigure(settings)
        self.revision += 1

    def interrupt(self, *, is_lost: bool) -> None:
        """Decide at once on the next newer odometry; without a pose it brakes as hard as it can."""
        self.estimator.lose_period()
        self.clock.interrupt()
        if is_lost:
            self.following.ramp = NO_RAMP

    def take_back(self, took: float) -> None:
        """Take back the last command, which was not sent since it took so long [s]."""
        # The ramp of the command before is forgotten.
        self.following.previous_control = self.estimator.take_back()
        self.lateness.add(took)
        self.interrupt(is_lost=True)

    def record(self, decision: Decision, tracks: tuple[MovingObject, ...] = ()) -> Decision:
        """Record a decision, completed with slip, lag and surroundings."""
        estimator, response = self.estimator, self.estimator.response
        stops = decision.level == FallbackLevel.STOP
        control = self.following.previous_control
        estimator.note_command(decision.stamp, control, decision.twist, stops=stops)
        if not stops:
            self.following.commanded_at = decision.stamp
        if self.sighted is not None:
            decision = decision._replace(sighting=self.sighted)
        lag = response.lag_interval
        if estimator.used_slip == 0.0 and not tracks and lag is None:
            return decision
        return decision._replace(
            wheel_slip=estimator.used_slip,
            wheel_lag=lag,
            response_delay=response.delay_interval,
            tracks=tracks,
        )
