"""The data's way through the guidance node: odometry, decision, command."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from cmpsp_ros.guidance.decision import FallbackLevel
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.messages.clock_reset import TimeJump
from cmpsp_ros.guidance.messages.odometry import OdometryError, check_age, stamp_of
from cmpsp_ros.guidance.mission.start import reason_not_to_begin
from cmpsp_ros.nodes.common.health import StepTimes
from cmpsp_ros.nodes.common.topics import GUIDANCE_ODOM
from cmpsp_ros.nodes.guidance.inputs.clock_watchdog import ClockWatch
from cmpsp_ros.nodes.guidance.inputs.goal_input import GoalInput
from cmpsp_ros.nodes.guidance.inputs.map_input import MapInput
from cmpsp_ros.nodes.guidance.inputs.obstacle_input import ObstacleInput
from cmpsp_ros.nodes.guidance.inputs.odometry_bytes import Odometry, read_odometry
from cmpsp_ros.nodes.guidance.inputs.odometry_watchdog import OdometryWatchdog
from cmpsp_ros.nodes.guidance.inputs.road_input import RoadInput
from cmpsp_ros.nodes.guidance.inputs.sensor_input import SensorInput
from cmpsp_ros.nodes.guidance.inputs.transform_input import TransformInput
from cmpsp_ros.nodes.guidance.outputs.publishers import GuidanceOutputs
from cmpsp_ros.nodes.timing.drain_queue import drain_queue, take_newest

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.guidance.decision import Decision
    from cmpsp_ros.guidance.settings import GuidanceSettings
    from cmpsp_ros.nodes.timing.garbage import GarbageCollection
    from cmpsp_ros.parameters.table import Values

_WATCH_PERIOD = 0.025

_LATEST_ODOMETRY = 5_000_000
"""How long after the final time its odometry may come before the clock stops the robot [ns]."""


class GuidanceLoop:
    """Feeds odometry to the guidance law and publishes what it decides, while it is active.

    Odometry that is lost or cannot be used, and any exception, is answered with a zero twist.

    Attributes:
        active: Whether odometry is decided on.
        decision: The latest decision; None before the first.
        road: Where the road comes from.
        map: Where the map comes from.
        silence: How long ago odometry was heard of.
        times: Computing times of control steps.
    """

    def __init__(
        self,
        node: LifecycleNode,
        values: Values,
        settings: GuidanceSettings,
        garbage: GarbageCollection,
    ) -> None:
        """Open the topics, and wait to be active.

        Args:
            node: The node.
            values: Its parameters.
            settings: What they amount to.
            garbage: Collected where there is time for it.
        """
        self._node, self._settings, self._garbage = node, settings, garbage
        self.active = False
        self._law = GuidanceLaw(settings, time.perf_counter_ns)
        self._outputs = GuidanceOutputs(node, values, settings)
        self._transforms = TransformInput(node, values['robot_frame'], settings)
        self._obstacles = ObstacleInput(node, settings, self._transforms)
        self._sensors = SensorInput(node, settings)
        self.road = RoadInput(node, values, self._transforms)
        self.map = MapInput(node, values, self._transforms)
        self._odometry = GUIDANCE_ODOM.listen_on(node, self._on_odometry, raw=True)
        self._goals = GoalInput(
            node,
            self._law,
            self._transforms,
            self.road,
            lambda: self.active,
            waits=values['goal.wait'],
        )
        self._timer = node.create_timer(_WATCH_PERIOD, self._watch)
        self._end_timer = node.create_timer(_WATCH_PERIOD, self._on_end)
        self._end_timer.cancel()
        self._begin()

    def close(self) -> None:
        """Close the topics."""
        self._node.destroy_subscription(self._odometry)
        self._goals.close()
        self._node.destroy_timer(self._timer)
        self._node.destroy_timer(self._end_timer)
        self._obstacles.close()
        self._sensors.close()
        self._transforms.close()
        self.road.close()
        self.map.close()
        self._outputs.close()

    def reset(self) -> None:
        """Begin again: the next odometry is time 0."""
        self._goals.end('The run began again.')
        self._begin()
        self._law.reset()

    def _begin(self) -> None:
        self.decision: Decision | None = None
        self.times = StepTimes()
        self.watchdog = OdometryWatchdog()
        self._clock_watch = ClockWatch()
        self._time_jump = TimeJump()
        self._halted_at: int | None = None
        self._pose: list[float] = []
        self._begun = False
        self._outputs.listeners.begin()

    def take(self, settings: GuidanceSettings) -> None:
        """Take other settings, from the next control step on."""
        self._settings = settings
        self._law.reconfigure(settings)
        self._obstacles.settings = self._transforms.settings = settings
        self._scenery_changed = True
        if not self.active:
            self.show()

    def show(self) -> None:
        """Send road, obstacles and goals; before a road came there is none to be seen."""
        if not self.road.waits:
            ahead = None if self.decision is None else self.decision.goal
            self._outputs.show(self._law.task, ahead)
        self._scenery_changed = self.road.waits

    def rest(self, reason: str) -> None:
        """Stop the robot for a reason in a sentence, and be active no more."""
        self._halt(reason)
        self._goals.end(reason)
        self.active = False

    def _halt(self, reason: str) -> None:
        cancelled = reason == self._goals.cancelled
        decision = self._law.halt(self._now(), reason, cancelled=cancelled)
        if self.decision is not None and self.decision.plan is not None:
            # It has driven on since odometry was heard of last.
            self._pose = self.decision.plan.pose_at(self.decision.stamp, decision.stamp)
        self._outputs.command(decision)
        self._note(decision)

    @property
    def subscribers(self) -> dict[str, int]:
        """How many listen to what every decision is told by, for diagnostics."""
        return self._outputs.subscribers

    @property
    def odometry_age(self) -> float | None:
        """How long ago odometry was heard of [s]; None if it never was."""
        return self.watchdog.age(self._now())

    def warnings(self) -> list[str]:
        """What is wrong around the decisions, in sentences."""
        now = self._now()
        return [
            *self._obstacles.warnings(now),
            *self._sensors.warnings(),
            *self._clock_watch.warnings(now),
            *(self._outputs.listeners.warnings() if self._begun else ()),
            *self.times.warnings(),
            *self._law.foretold,
        ]

    @property
    def waiting(self) -> str:
        """What must still come before time 0, in a sentence; empty when all is there."""
        if self.road.waits:
            return 'Waiting for a road on the topic road.'
        return self.map.waiting or ('' if self._begun else self._outputs.listeners.lacking())

    def _on_odometry(self, data: bytes) -> None:
        self.map.try_again()
        if not self.active or self.waiting:
            return
        began, now = time.perf_counter_ns(), self._now()
        try:
            message, newest = self._newest(data, now)
            pose, is_transformed = self._transforms.pose_of(message, newest)
            stamp = stamp_of(message)
            check_age(stamp, now, self._settings.odom_timeout)
        except OdometryError as error:
            self._halt_for(str(error))
            return
        self._outputs.name_robot(self._transforms.robot_frame(message.child_frame_id))
        self.watchdog.end(now)
        self._pose = pose.tolist()
        self._notice_time(stamp)
        if not self._begun and (why := reason_not_to_begin(self._settings, pose)):
            self._halt_for(why)
            return
        blindness = self._sensors.note(stamp, pose)
        if why := self._goals.cancelled or blindness or self.map.trouble(stamp):
            self._halt_for(why)
            return
        try:
            is_due = self._law.is_due(stamp)
            tracks = self._obstacles.at(stamp) if is_due else ()
            sighting = self._sensors.at(stamp, pose) if is_due else None
            decision = self._law.update(stamp, pose, tracks, sighting)
        except Exception as error:  # the robot must stop for any
            self._halt_for(f'The guidance law failed: {type(error).__name__}: {error}')
            return
        if decision is None:
            return
        sent = self._now()
        decision = decision._replace(skipped=newest is not data)
        if is_transformed:
            decision = decision._replace(pose=tuple(self._pose))
        period, took = self._settings.control_period, (sent - now) / NANOSECONDS
        if took > period and decision.plan is not None:
            decision = self._law.withdraw(decision, took)
            self._node.get_logger().warning(decision.reason)
        else:
            self._outputs.command(decision)
        self._expect_end(decision, now)
        step_ms = (time.perf_counter_ns() - began) / 1e6
        answer_ms, delay = (sent - stamp) / 1e6, self._settings.command_delay
        self.times.add(step_ms, answer_ms, period, delay, is_late=decision.late > 0.0)
        decision = self._law.foretell(decision, pose)
        if not self._begun:
            for each in self._law.foretold:
                self._node.get_logger().warning(each)
        self._begun = True
        if self.decision is None or decision.goal != self.decision.goal:
            self._scenery_changed = True
        taken = {'step': step_ms, 'odometry_to_command': answer_ms}
        self._note(decision._replace(phases={**decision.phases, **taken}))
        try:
            self._law.search(pose)
        except Exception as error:
            self._halt_for(f'The search of the grid failed: {type(error).__name__}: {error}')
        self._use_slack(period - (time.perf_counter_ns() - began) / 1e9)

    def _newest(self, data: bytes, now: int) -> tuple[Odometry, bytes]:
        """Odometry, and its bytes: of newer odometry that waits, where this has grown old."""
        message = read_odometry(data)
        stamp = stamp_of(message)
        age = (now - stamp) / NANOSECONDS
        if age <= self._settings.control_period or not self._law.is_due(stamp):
            return message, data
        newest = take_newest(self._odometry) or data
        return read_odometry(newest), newest

    def _expect_end(self, decision: Decision, now: int) -> None:
        """See to it that the robot stops in time where odometry does not come just then."""
        end = self._law.ends_at
        if decision.finished or end is None:
            return
        self._end_timer.timer_period_ns = max(1, end - now) + _LATEST_ODOMETRY
        self._end_timer.reset()

    def _on_end(self) -> None:
        self._end_timer.cancel()
        # Odometry of that instant comes first where it is there; in lockstep it always is.
        drain_queue(self._odometry)
        now, end = self._now(), self._law.ends_at
        is_over = self._is_finished or self._goals.cancelled
        if self.active and end is not None and now > end and not is_over:
            decision = self._law.halt(now, 'The final time has passed.', finished=True)
            self._outputs.command(decision)
            self._note(decision)

    @property
    def _is_finished(self) -> bool:
        return self.decision is not None and self.decision.finished

    def _use_slack(self, slack: float = math.inf) -> None:
        """Do what can wait until the command is out, and the next is not yet due."""
        if self._scenery_changed:
            self.show()
        self._garbage.collect(slack)

    def _notice_time(self, stamp: int) -> None:
        """Begin the run again when time has: odometry fits the clock, but not what came before."""
        back = self._time_jump.back(stamp)
        if back > self._settings.odom_timeout:
            said = f'time has jumped back by {back:.3f} s: the run begins again'
            self._node.get_logger().warning(said)
            self._law.reset()
            self._goals.end(said)
            self._begun = False
            self._obstacles.forget_after(stamp)
            self._sensors.forget()

    def _watch(self) -> None:
        if not self.active:
            return
        if self._garbage.overdue:
            self._use_slack()
        timeout = self._settings.odom_timeout
        if self.watchdog.is_longer_than(timeout, self._now()):
            drain_queue(self._odometry)
        if self.watchdog.goes_on(timeout, self._now()):
            self._halt_for(f'No usable odometry for more than {timeout} s (odom_timeout).')

    def _halt_for(self, reason: str) -> None:
        """Stop now, and again every control period while the reason lasts."""
        now = self._now()
        period = self._settings.control_period * 1e9
        if self._halted_at is None or not 0 <= now - self._halted_at < period:
            self._halt(reason)
            self._halted_at = now

    def _note(self, decision: Decision) -> None:
        self._outputs.report(decision, self._pose)
        self._goals.note(decision, self._pose)
        before = self.decision
        if before is None or (decision.level, decision.missed) != (before.level, before.missed):
            said = f'{decision.level.name.lower()}: {decision.reason}'
            # rclpy refuses one place in the code that logs at two levels.
            if decision.level == FallbackLevel.NOMINAL or decision.finished or decision.cancelled:
                self._node.get_logger().info(said)
            else:
                self._node.get_logger().warning(said)
        self.decision, self._halted_at = decision, None

    def _now(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
