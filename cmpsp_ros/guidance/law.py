"""The guidance law: one pure object from odometry to decisions."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Decision, Plan, Rung
from cmpsp_ros.guidance.decision_builder import Account
from cmpsp_ros.guidance.horizon import NANOSECONDS, NEVER, Horizon, remaining, shift, to_nanoseconds
from cmpsp_ros.guidance.messages.goal_pose import GoalError, check_goal
from cmpsp_ros.guidance.messages.peer_trajectories import Seen
from cmpsp_ros.guidance.mission.goal_manager import Itinerary
from cmpsp_ros.guidance.mission.goals import Goal, place_of
from cmpsp_ros.guidance.mission.return_to_goal import way_back
from cmpsp_ros.guidance.planning.candidate import Start, inside
from cmpsp_ros.guidance.planning.plan_selector import Choice
from cmpsp_ros.guidance.planning.progress import Progress
from cmpsp_ros.guidance.planning.solve_result import Improvement
from cmpsp_ros.guidance.prediction.obstacle_tracker import Lookout
from cmpsp_ros.guidance.prediction.pending_commands import CommandsUnderWay
from cmpsp_ros.guidance.prediction.slip import SlipEstimate
from cmpsp_ros.guidance.safety.audit import Audit, Verdict
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.obstacles.moving_discs import NOTHING_MOVES, MovingDiscs

Array = NDArray[np.float64]


class GuidanceLaw:
    """Clock to horizon, warm start, iterations, audit, ladder, command.

    It reads no clock and no file: the same odometry gives the same decisions, bit for bit. What a
    command of now cannot change any more, since it takes effect after `command_delay`, is foreseen
    from the commands that the law itself has given.
    """

    def __init__(self, settings: GuidanceSettings, timer: Callable[[], int] = lambda: 0) -> None:
        """Start at rest, waiting for the first odometry.

        Args:
            settings: All settings.
            timer: Monotonic time [ns], for the computing times in decisions; decides nothing.
        """
        self._timer, self._settings = timer, settings
        self._lookout = Lookout()
        self._slip = SlipEstimate()
        self._itinerary = Itinerary(settings)
        self._account = Account(self._itinerary)
        self.reconfigure(settings)
        self.reset()

    def reset(self) -> None:
        """Begin again: the next odometry is time 0."""
        self._account.begin()
        self._start: int | None = None
        self._passed: Array | None = None
        self._due = 0
        self._latest = 0
        self._held = np.zeros(2)
        self._under_way = CommandsUnderWay()
        self._lookout.forget()
        self._itinerary.reset()
        self._near = math.nan
        self._slip.forget(self._settings.max_slip)
        if self._reckoned.slip != self._slip.slip:
            self._reckon()
        self._progress.forget()
        self._forget()

    def _forget(self) -> None:
        """Drop the plan, and what is known of others."""
        self._plan: Plan | None = None
        self._waiting: Plan | None = None
        self._choice.forget()

    def reconfigure(self, settings: GuidanceSettings) -> None:
        """Take new settings, from the next control step on."""
        self._account.revision += 1
        if settings.road != self._settings.road:
            self._near = math.nan
        self._settings = settings
        self._reckon()
        self._progress = Progress(settings)
        self._period = to_nanoseconds(settings.control_period)
        self._delay = to_nanoseconds(settings.command_delay)

    def _reckon(self) -> None:
        """Reckon with the slip that is estimated, from now on."""
        slip = min(self._slip.slip, self._settings.max_slip)
        self._reckoned = replace(self._settings, slip=slip)
        self._itinerary.reconfigure(self._reckoned)
        self._audit = Audit(self._reckoned)
        kept = self._settings.robot_radius + self._settings.safety.margin
        self._with_margin = Audit(replace(self._reckoned, robot_radius=kept))
        self._choice = Choice(self._itinerary.settings, self._audit, self._timer)

    def is_due(self, stamp: int) -> bool:
        """Whether odometry of this time [ns] is one to decide on."""
        return self._start is None or stamp - self._start >= self._due

    def update(self, stamp: int, pose: Array, tracks: tuple[Seen, ...] = ()) -> Decision | None:
        """Decide, if a control step is due.

        Args:
            stamp: Time stamp of the odometry [ns].
            pose: Pose ``(x, y, heading)`` [m, m, rad], finite; the heading may be wrapped.
            tracks: Obstacles that move, and plans of other robots, as they are known then, each
                once.

        Returns:
            The decision, or None between two control steps and for odometry older than the last.
        """
        if not self.is_due(stamp):
            return None
        if self._start is None:
            self._start = stamp
        now = stamp - self._start
        self._latest = now
        moving = self._lookout.at(stamp, pose, tracks, self._settings.moving_obstacles)
        self._end_period(stamp, pose)
        start, itinerary = self._foresee(stamp, pose, moving), self._itinerary
        turned = itinerary.go_on(stamp, now, start.pose, start.near)
        if now >= itinerary.end:
            self._due = now + self._period
            return self._sent(self._finish(stamp, pose, moving), tracks)
        self._passed = None
        horizon = remaining(now, self._period, itinerary.final)
        self._due = horizon.next_instant
        # A command that is given later takes effect after the final time.
        last = itinerary.final - self._delay
        if itinerary.is_last and (now >= last or self._is_settled(last - now)):
            decision = self._go_on(stamp, pose, start, last)
        else:
            horizon = remaining(now, self._period, last) if self._delay else horizon
            self._choice.aim(itinerary.aim(len(horizon.durations)))
            self._progress.aim(itinerary.settings)
            known = self._turn(start, horizon) if turned else self._plan or self._waiting
            decision = self._decide(stamp, pose, start, horizon, known)
        self._decide_in_time(start, decision.plan, last)
        self._account.step += 1
        self._begin_period(stamp, pose, decision.wheel_speeds)
        return self._sent(decision, tracks)

    def _begin_period(self, stamp: int, pose: Array, wheel_speeds: Array) -> None:
        if self._settings.max_slip > 0.0:
            ahead, durations = self._under_way.until(stamp, self._delay)
            speeds = np.array([self._under_way.in_force, *ahead, wheel_speeds])
            self._slip.begin(stamp, pose, speeds, durations)

    def _end_period(self, stamp: int, pose: Array) -> None:
        most = self._settings.max_slip
        if most > 0.0 and self._slip.end(stamp, pose, self._settings.robot, most):
            self._reckon()

    def _turn(self, start: Start, horizon: Horizon) -> Plan | None:
        """Look for a way to another goal; a plan to begin with, where no road says it."""
        self._choice.forget()
        self._progress.forget()
        if not self._itinerary.is_return:
            return None
        settings, durations = self._itinerary.settings, horizon.durations
        controls = way_back(settings, start.pose, durations)
        poses = settings.model.roll_out(start.pose, controls, durations)
        return Plan(horizon, controls, poses, self._delay)

    @property
    def task(self) -> GuidanceSettings:
        """The settings, with the goal that was told instead of theirs where there is one."""
        return self._itinerary.task

    def tell(self, stamp: int, goal: Goal) -> None:
        """Take another goal instead of all others, at the first control step that is not older.

        Args:
            stamp: Its time stamp [ns]; 0 for at once.
            goal: The goal; when to pass it follows from the way to it and from the nominal speed.

        Raises:
            GoalError: It is refused, and nothing changes.
        """
        self._itinerary.heard += 1
        check_goal(self._settings, self._audit, goal)
        latest = self._latest + (self._start or 0)
        if self._start is not None and stamp - latest > to_nanoseconds(self._settings.odom_timeout):
            ahead = (stamp - latest) / NANOSECONDS
            raise GoalError(
                f'The goal is {ahead:.3f} s ahead of the last odometry; is use_sim_time right?'
            )
        self._itinerary.tell(stamp, goal)

    @property
    def ends_at(self) -> int | None:
        """When the robot is to stop at the latest, a time stamp [ns]; None where none is known."""
        if self._start is None or self._itinerary.end >= NEVER:
            return None
        return self._start + self._itinerary.end

    def halt(self, stamp: int, reason: str, *, finished: bool = False) -> Decision:
        """Stop for a reason that odometry does not show.

        The plan is dropped, and the next newer odometry is decided on at once.

        Args:
            stamp: Present time [ns].
            reason: Why, in a sentence.
            finished: Whether it is the final time, which the next odometry is to judge.
        """
        self._forget()
        self._slip.lose()
        self._due = 0 if self._start is None else self._latest + 1
        nowhere = np.full(3, math.nan)
        return self._sent(self._halt(stamp, nowhere, reason, finished=finished, halted=True))

    def _sent(self, decision: Decision, tracks: tuple[Seen, ...] = ()) -> Decision:
        self._under_way.add(decision.stamp, decision.wheel_speeds)
        slip = self._reckoned.slip
        if slip == 0.0 and not tracks:
            return decision
        return decision._replace(wheel_slip=slip, tracks=tracks)

    def _foresee(self, stamp: int, pose: Array, moving: MovingDiscs) -> Start:
        road = self._settings.road
        near = self._near = place_of(road, pose, self._near)
        wheel_speeds, durations = self._under_way.until(stamp, self._delay)
        if not len(durations):
            return Start(pose, None, moving, near)
        ahead = self._reckoned.model.roll_out(pose, wheel_speeds, durations)[-1]
        way = self._audit.check_way(pose, wheel_speeds, durations, moving, near)
        there = place_of(road, ahead, near)
        return Start(ahead, way, moving.after(float(durations.sum())), there)

    def _is_settled(self, left: int) -> bool:
        """Whether the last plan left no more commands for the time that is left [ns]."""
        return self._delay > 0 and self._plan is not None and left < self._period // 2

    def _decide_in_time(self, start: Start, plan: Plan | None, last: int) -> None:
        """Decide once more if the last command on the way to a goal may not outlast its time.

        By itself it does, by as long as the next one takes to come into effect: a stop, or the
        first on the way to another goal.
        """
        if self._delay == 0 or plan is None or len(plan.horizon.durations) > 1:
            return
        if self._latest < last and not self._may_outlast(start, plan.controls, self._due):
            self._due = last

    def _may_outlast(self, start: Start, controls: Array, until: int) -> bool:
        """Whether commands may go on until one that is given at an instant [ns] takes effect.

        No plan has looked at the way beyond its end: it keeps the margin that plans keep, or is
        not driven.
        """
        outlasting = np.array([(until - self._latest) / NANOSECONDS])
        verdict = self._with_margin.check(
            start.pose, controls[:1], outlasting, start.moving, start.near
        )
        return verdict.passed

    def _go_on(self, stamp: int, pose: Array, start: Start, last: int) -> Decision:
        """Let the last plan go on, past its end too, where a new command comes too late.

        Too early a stop would cost the goal if the delay is shorter than it is said to be, or the
        wheels rather lag.
        """
        end = last if self._latest < last else self._due
        horizon = Horizon.between(np.array([self._latest, end], dtype=np.int64))
        shifted = self._shifted(start, horizon)
        beyond = self._latest >= last
        if (
            self._plan is None
            or shifted is None
            or (beyond and not self._may_outlast(start, shifted[0].controls, end))
        ):
            reason = 'No plan can go on until a stop takes effect.'
            return self._halt(stamp, pose, reason, moving=start.moving)
        plan, verdict = shifted
        reason = 'The plan goes on: a new command comes too late to change its end.'
        return self._account.following(
            stamp,
            Rung.NOMINAL,
            reason,
            plan,
            verdict,
            self._settings.robot,
            time_left=self._account.time_left(self._latest),
            **self._account.misses(self._plan.poses[-1]),
        )

    def _decide(
        self, stamp: int, pose: Array, start: Start, horizon: Horizon, known: Plan | None
    ) -> Decision:
        if self._plan is None and (reason := inside(pose, self._audit)):
            return self._halt(stamp, pose, reason, moving=start.moving)
        if self._lookout.surprised:
            self._choice.look_again()
        self._waiting = None
        candidate = self._choice.best(start, self._held, known, horizon)
        improvement, verdict, plan = candidate.improvement, candidate.verdict, candidate.plan
        rung = Rung.ELASTIC if candidate.gives_way else Rung.NOMINAL
        described = candidate.describe(self._audit, self._itinerary.settings, start.moving)
        reason = described + self._choice.remark
        if candidate.usable:
            self._account.failures = 0
            # Before something that moves, standing still is no safe thing to wait by.
            waits = not len(start.moving)
            if waits and (why := self._progress.reason_to_wait(candidate, start.near)):
                self._plan, self._waiting = None, plan
                return self._halt(stamp, pose, f'{why} {reason}', improvement)
        else:
            self._account.failures += 1
            reason = verdict.reason if improvement.solved else improvement.reason
            shifted = self._shifted(start, horizon)
            if shifted is None:
                self._progress.stand()
                self._forget_after_failures()
                return self._halt(stamp, pose, reason, improvement, moving=start.moving)
            rung, (plan, verdict) = Rung.SHIFTED, shifted
            reason += ' The last audited plan goes on.'
        self._plan = plan
        self._held = plan.controls[0]
        self._forget_after_failures()
        return self._account.following(
            stamp,
            rung,
            reason,
            plan,
            verdict,
            self._settings.robot,
            slack=improvement.slack if improvement.elastic else 0.0,
            iterations=improvement.iterations,
            qp_iterations=improvement.qp_iterations,
            active_rows=improvement.active_rows,
            phases=self._choice.phases,
        )

    def _shifted(self, start: Start, horizon: Horizon) -> tuple[Plan, Verdict] | None:
        """The last audited plan, shifted by the time that has passed, if it is still clear."""
        if self._plan is None:
            return None
        controls = shift(self._plan.controls, self._plan.horizon, horizon)
        verdict = self._choice.judge(start, controls, horizon)
        if not verdict.passed:
            return None
        poses = self._reckoned.model.roll_out(start.pose, controls, horizon.durations)
        return Plan(horizon, controls, poses, self._delay), verdict

    def _finish(self, stamp: int, pose: Array, moving: MovingDiscs) -> Decision:
        settings, missed, where = self._itinerary.settings, False, ''
        self._plan = None
        if self._itinerary.goal is not None:
            passed = self._pose_at_end(stamp, pose)
            miss, off = settings.miss(passed), settings.heading_miss(passed) or 0.0
            missed = miss > settings.goal_tolerance or off > settings.heading_tolerance
            if miss > settings.goal_tolerance:
                where = f', {miss:.3g} m from the goal'
            elif missed:
                where = f", {off:.3g} rad off the goal's heading"
        reason = f'The final time has passed{where}.'
        stop = self._halt(stamp, pose, reason, finished=True, moving=moving)
        if self._passed is not None:
            stop = stop._replace(**self._account.misses(self._passed))
        return stop._replace(missed=missed)

    def _pose_at_end(self, stamp: int, pose: Array) -> Array:
        """Where the robot was at the final time, which odometry need not meet.

        It is driven back by the commands since, unless odometry has come too late to be sure.
        """
        since = (self._start or 0) + self._itinerary.end
        if self._passed is None and 0 < stamp - since <= self._period:
            speeds, durations = self._under_way.since(since, stamp, self._delay)
            self._passed = self._reckoned.model.roll_out(pose, speeds, -durations)[-1]
        return pose if self._passed is None else self._passed

    def _forget_after_failures(self) -> None:
        if self._account.failures >= self._settings.failure_tolerance:
            self._forget()

    def _halt(
        self,
        stamp: int,
        pose: Array,
        reason: str,
        improvement: Improvement | None = None,
        *,
        finished: bool = False,
        halted: bool = False,
        moving: MovingDiscs = NOTHING_MOVES,
    ) -> Decision:
        self._held = np.zeros(2)
        return self._account.standing(
            stamp,
            0 if self._start is None else stamp - self._start,
            pose,
            reason,
            float(self._audit.at(pose, moving, self._near).min()),
            iterations=0 if improvement is None else improvement.iterations,
            finished=finished,
            halted=halted,
        )


def warm_up(settings: GuidanceSettings) -> None:
    """Decide once, far from any run, so that all compiled code is loaded.

    Raises:
        ValueError: The settings cannot be worked with.
    """
    GuidanceLaw(settings).update(0, settings.road.middle())
