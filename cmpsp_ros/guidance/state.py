"""What the guidance law remembers from one control step to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Decision, Plan
from cmpsp_ros.guidance.horizon import to_nanoseconds
from cmpsp_ros.guidance.messages.tracks import MovingObject
from cmpsp_ros.guidance.mission.closed_road import ClosedRoad
from cmpsp_ros.guidance.mission.goal_manager import GoalManager
from cmpsp_ros.guidance.prediction.obstacle_tracker import ObstacleTracker
from cmpsp_ros.guidance.prediction.pending_commands import PendingCommands
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.prediction.response import Risk
from cmpsp_ros.guidance.prediction.response_estimate import ResponseEstimate
from cmpsp_ros.guidance.prediction.slip import SlipEstimate
from cmpsp_ros.guidance.safety.audit import Verdict
from cmpsp_ros.guidance.safety.lateness import Lateness
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import NOT_SEARCHED, Searched, World
from cmpsp_ros.robots import NO_RAMP, Robot
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.obstacles import MovingDiscs
from cmpsp_ros.world.roads import project_on_path

_NOTHING: Final = np.empty((0, 0)), np.empty(0)
"""Controls that a robot without a delay is driven by until a new one takes effect."""


@dataclass
class LawState:
    """One run of the law; a new run begins with a new state.

    Attributes:
        world: Road and static obstacles, with what is seen.
        goals: Which goal is driven to.
        slip: Estimate of the wheel slip.
        response: Estimate of how the robot responds to commands.
        robot: Kinematics, with that slip.
        used_slip: The slip that it has.
        run: How many runs there were before.
        revision: How often the law had been given new settings before.
        previous_control: Control commanded last, shape ``(r,)``.
        pending: Commands that have not taken effect yet.
        start: Time stamp of the first odometry [ns]; None before it.
        now: Time of the last odometry since then [ns].
        due: When the next control step falls due [ns].
        delay: From a command to its effect, with the lag that is estimated [ns].
        step: Control steps of this run so far.
        failures: Failed control steps in a row.
        reaches_goal: Whether the last plan ended within the tolerance of the goal.
        idle_steps: Control steps that brought the goal no nearer, since one could reach it.
        progress: Arc length of the robot along the road, NaN if not needed [m].
        commanded_at: Time stamp that this command answers [ns].
        ramp: Commands by which it can be stopped, audited; shape ``(K, r)``.
        plan: The plan that is followed, if any.
        end_speed: Largest speed at which a car may come to the goal; infinite for any [m/s].
        waiting: A plan that is improved while the robot waits.
        final_pose: Where the robot was at the final time, shape ``(3,)`` [m, m, rad]; None before.
        tracker: Slots of moving obstacles.
        lateness: Of control steps that took too long.
        sighting: What is known of the surroundings; None without sensors.
        searched: Inputs of the search for the next control step.
        closed_road: What closes the road to the present goal.
        foretold: What no plan of the run can do, in sentences.
    """

    world: World
    goals: GoalManager
    slip: SlipEstimate
    response: ResponseEstimate
    robot: Robot
    used_slip: float
    run: int
    revision: int
    previous_control: Array
    pending: PendingCommands
    start: int | None = None
    now: int = 0
    due: int = 0
    delay: int = 0
    step: int = 0
    failures: int = 0
    reaches_goal: bool = True
    idle_steps: int = 0
    progress: float = math.nan
    commanded_at: int = 0
    ramp: Array = field(default_factory=lambda: NO_RAMP)
    plan: Plan | None = None
    end_speed: float = math.inf
    waiting: Plan | None = None
    final_pose: Array | None = None
    tracker: ObstacleTracker = field(default_factory=ObstacleTracker)
    lateness: Lateness = field(default_factory=Lateness)
    sighting: Sighting | None = None
    searched: Searched = NOT_SEARCHED
    closed_road: ClosedRoad = field(default_factory=ClosedRoad)
    foretold: tuple[str, ...] = ()

    @classmethod
    def begin(cls, settings: LawSettings, world: World, run: int, revision: int) -> LawState:
        """The state before the first odometry of a run."""
        slip = SlipEstimate(settings.max_slip)
        used = min(slip.slip, settings.max_slip)
        robot = settings.robot.slipping(used)
        response, rest = ResponseEstimate(settings), robot.at_rest
        pending = PendingCommands(robot.n_controls)
        goals = GoalManager(settings, world)
        return cls(world, goals, slip, response, robot, used, run, revision, rest, pending)

    def reconfigure(self, settings: LawSettings, world: World) -> None:
        """Go on with other settings, in another world; what is seen stays."""
        if world.road != self.world.road:
            self.progress = math.nan
        self.world = replace(world, seen=self.world.seen, searched=self.world.searched)
        self.goals.reconfigure(settings, self.world)
        self.use_slip(settings)
        self.response.reconfigure(settings)
        self.revision, self.idle_steps = self.revision + 1, 0
        self.closed_road = ClosedRoad()

    def follow(self, plan: Plan, verdict: Verdict) -> None:
        """Give the first command of a plan, and keep the ramp by which it can be stopped."""
        self.previous_control, self.ramp = plan.controls[0], verdict.ramp

    def brake(self, stamp: int, period: int) -> None:
        """Give the next command of the ramp; one at rest or without a ramp stops at once.

        Args:
            stamp: Time stamp that it answers [ns]. A stop by the clock and the next odometry may
                come at once: that is one command.
            period: Control period [ns].
        """
        if not len(self.ramp):
            self.previous_control = self.robot.stopped(self.previous_control)
        elif stamp - self.commanded_at >= period // 2:
            self.previous_control, self.ramp = self.ramp[0], self.ramp[1:]

    def interrupt(self, *, is_lost: bool) -> None:
        """Decide at once on the next newer odometry.

        Args:
            is_lost: Whether nobody knows where the robot is: no path is known to be clear, so it
                brakes as hard as its motors can.
        """
        self.lose_period()
        self.due = 0 if self.start is None else self.now + 1
        self.ramp = NO_RAMP if is_lost else self.ramp

    def sent(self, decision: Decision, tracks: tuple[MovingObject, ...] = ()) -> Decision:
        """Note a command that is sent.

        Args:
            decision: What is decided.
            tracks: Moving obstacles, and trajectories of other robots, that were known.

        Returns:
            It, with what was known of slip, lag and surroundings.
        """
        self.pending.add(decision.stamp, self.previous_control, decision.twist)
        self.commanded_at = decision.stamp
        if self.sighting is not None:
            decision = decision._replace(sighting=self.sighting.stamp)
        lag, delay = self.response.lag_interval, self.response.delay_interval
        if self.used_slip == 0.0 and not tracks and lag is None:
            return decision
        return decision._replace(
            wheel_slip=self.used_slip, wheel_lag=lag, response_delay=delay, tracks=tracks
        )

    def risk(self, stamp: int) -> Risk:
        """How else the robot may respond than plans assume."""
        return self.response.risk(stamp, self.pending)

    def take_back(self, took: float) -> None:
        """Take back the last command, which was not sent since it took so long [s]."""
        # The ramp of the command before is forgotten.
        self.previous_control = self.pending.take_back()
        self.lateness.add(took)
        self.interrupt(is_lost=True)

    def predict(
        self, stamp: int, pose: Array, moving: MovingDiscs
    ) -> tuple[PlanStart, PlanStart, tuple[Array, Array]]:
        """Where the robot is, where a plan begins, and the controls that lead there.

        A plan begins where the robot will be when a command given now takes effect. One whose
        wheels lag by ``T`` moves as one whose wheels obey at once, so much later: until then they
        keep the speeds that they have when the command reaches them.

        Args:
            stamp: Present time [ns].
            pose: Where the robot is, shape ``(3,)`` [m, m, rad].
            moving: Moving obstacles.

        Returns:
            The present state, the initial state of a plan, and the controls that the commands given
            before have in effect until the new one reaches the wheels, ``(K, r)``, each for so long
            ``(K,)`` [s].
        """
        road = self.world.road
        self.progress = project_on_path(road, pose, self.progress)
        here = PlanStart(pose, self.robot, self.world, moving, self.progress, self.previous_control)
        if not (self.response.delay or self.response.lag):
            self.delay = 0
            return here, here, _NOTHING
        response = self.response.in_use(stamp, self.pending)
        self.delay = self.response.delay + to_nanoseconds(response.lag)
        given = controls, durations = response.in_effect()
        if response.lag > 0.0:
            controls = np.vstack([controls, response.settled])
            durations = np.append(durations, response.lag)
        ahead = self.robot.roll_out(pose, controls, durations)[-1]
        progress = project_on_path(road, ahead, self.progress)
        later = moving.after(float(durations.sum()))
        return here, here._replace(pose=ahead, moving=later, progress=progress), given

    def begin_period(self, settings: LawSettings, stamp: int, pose: Array, control: Array) -> None:
        """Record how a control period begins, for the estimate of slip.

        Args:
            settings: All settings of the guidance law.
            stamp: When it begins [ns].
            pose: Where, shape ``(3,)`` [m, m, rad].
            control: Commanded then, shape ``(r,)``.
        """
        if settings.max_slip > 0.0:
            ahead, durations = self.pending.until(stamp, self.response.delay)
            speeds = np.array([self.pending.in_force, *ahead, control])
            self.slip.begin(stamp, pose, speeds, durations)

    def end_period(self, settings: LawSettings, stamp: int, pose: Array) -> bool:
        """Update the estimates at the end of a control period.

        Args:
            settings: All settings of the guidance law.
            stamp: When it ends [ns].
            pose: Where, shape ``(3,)`` [m, m, rad].

        Returns:
            Whether the slip is another one now.
        """
        self.response.update(stamp, pose, self.pending, self.robot, self.used_slip)
        limit = settings.max_slip
        if limit > 0.0 and self.slip.end(stamp, pose, settings.robot, limit):
            self.use_slip(settings)
            return True
        return False

    def lose_period(self) -> None:
        """Leave the present control period out of the estimates: nobody knows what happens."""
        self.slip.lose()
        self.response.lose()

    def pose_at_end(self, stamp: int, pose: Array, latest: int) -> Array:
        """Where the robot was at the final time, which odometry need not meet.

        It is driven back by the commands since, unless odometry has come too late to be sure.

        Args:
            stamp: Time stamp of the odometry [ns].
            pose: Where the robot is, shape ``(3,)`` [m, m, rad].
            latest: How long after the final time odometry may come [ns].
        """
        end = (self.start or 0) + self.goals.end
        if self.final_pose is None and 0 < stamp - end <= latest:
            speeds, durations = self.pending.since(end, stamp, self.response.delay)
            self.final_pose = self.robot.roll_out(pose, speeds, -durations)[-1]
        return pose if self.final_pose is None else self.final_pose

    def use_slip(self, settings: LawSettings) -> None:
        """Rebuild the model with the current slip estimate."""
        self.used_slip = min(self.slip.slip, settings.max_slip)
        self.robot = settings.robot.slipping(self.used_slip)
