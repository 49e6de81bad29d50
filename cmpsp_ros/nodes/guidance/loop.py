"""The data's way through the guidance node: odometry, decision, command."""

import math
import time
from functools import partial

import numpy as np
from rclpy.lifecycle import LifecycleNode

from cmpsp_ros.guidance import (
    NANOSECONDS,
    NEVER,
    Decision,
    FallbackLevel,
    GuidanceLaw,
    GuidanceSettings,
    Observation,
)
from cmpsp_ros.guidance.messages import Arrival, OdometryError, OdometryGate
from cmpsp_ros.guidance.mission import reason_not_to_begin
from cmpsp_ros.nodes.common.topic import watch_time, watch_timer
from cmpsp_ros.nodes.guidance.diagnostics import StepTimes
from cmpsp_ros.nodes.guidance.held_command import HeldCommand
from cmpsp_ros.nodes.guidance.inputs.course import MapInput, RoadInput
from cmpsp_ros.nodes.guidance.inputs.goals import GoalInput
from cmpsp_ros.nodes.guidance.inputs.odometry import ClockWatch, OdometryInput, OdometryWatchdog
from cmpsp_ros.nodes.guidance.inputs.surroundings import SensorInput, TrackInput
from cmpsp_ros.nodes.guidance.inputs.transforms import TransformInput
from cmpsp_ros.nodes.guidance.outputs.publishers import GuidanceOutputs
from cmpsp_ros.nodes.guidance.timing import GarbageCollection
from cmpsp_ros.parameters import Values

_WATCH_PERIOD = 0.025
_BEGAN_AGAIN = 'The run began again.'

# Wait for odometry of the final time before the clock stops the robot [ns].
_LATEST_ODOMETRY = 5_000_000


class GuidanceLoop:
    """Feeds odometry to the law and publishes its decisions while active; stops for any fault."""

    def __init__(
        self,
        node: LifecycleNode,
        values: Values,
        settings: GuidanceSettings,
        garbage: GarbageCollection,
    ) -> None:
        self._node, self._settings, self._garbage = node, settings, garbage
        self.active, self._in_lockstep = False, values['lockstep']
        self._law = GuidanceLaw(settings, settings.world, time.perf_counter_ns)
        self._transforms = TransformInput(node, values['robot_frame'], settings)
        self._tracks = TrackInput(node, settings, self._transforms)
        self._sensors = SensorInput(node, settings)
        seen = {'sighting': self._sensors.publisher, 'tracks': self._tracks.publisher}
        seen = {name: each for name, each in seen.items() if each is not None}
        self._outputs = GuidanceOutputs(node, values, settings, seen)
        self.road = RoadInput(node, values, self._transforms)
        self.map = MapInput(node, values, self._transforms)
        self._odometry = OdometryInput(node, self._on_odometry)
        sources = self._transforms, self.road
        waits = values['goal.wait']
        self._goals = GoalInput(node, self._law, *sources, lambda: self.active, waits=waits)
        self._watch_time = partial(watch_time, node)
        self._timer = watch_timer(node, _WATCH_PERIOD, self._watch)
        self._end_timer = node.create_timer(_WATCH_PERIOD, self._on_end)
        self._end_timer.cancel()
        self._begin()

    def close(self) -> None:
        """Close the topics."""
        for timer in (self._timer, self._end_timer):
            self._node.destroy_timer(timer)
        inputs = self._odometry, self._goals, self._tracks, self._sensors, self._transforms
        for each in (*inputs, self.road, self.map, self._outputs):
            each.close()

    def reset(self) -> None:
        """Begin again: the next odometry is time 0; until it comes an active robot stands."""
        if self.active:
            self._halt(_BEGAN_AGAIN)
        self._goals.end(_BEGAN_AGAIN)
        self._begin()
        self._law.reset()

    def _begin(self) -> None:
        self.decision: Decision | None = None
        self.times = StepTimes()
        self.watchdog = OdometryWatchdog()
        self.gate = OdometryGate()
        self._clock_watch = ClockWatch()
        self._halted_at: int | None = None
        self._trouble = ''
        self._held, self._over_at = HeldCommand(self._watch_time), NEVER
        self._pose: list[float] = []
        self._begun = self._lacks_clock = False
        self._outputs.listeners.begin()

    def take(self, settings: GuidanceSettings) -> None:
        """Take other settings, from the next control step on."""
        self._settings = settings
        self._law.reconfigure(settings, settings.world)
        self._transforms.settings = settings
        self._tracks.settings = settings
        self._scenery_changed = True
        if not self.active:
            self.show()

    def show(self) -> None:
        """Send road, obstacles and goals; before a road came there is none to be seen."""
        if not self.road.waits:
            ahead = None if self.decision is None else self.decision.goal
            self._outputs.show(self._law.task, self._law.world, ahead)
        self._scenery_changed = self.road.waits

    def rest(self, reason: str) -> None:
        """Stop the robot for a reason in a sentence, and be active no more."""
        self._halt(reason)
        self._goals.end(reason)
        self.active = False

    def _halt(self, reason: str, *, braking: bool = False) -> None:
        cancelled = reason == self._goals.cancelled
        decision = self._law.halt(self._now(), reason, cancelled=cancelled, braking=braking)
        self.gate.note_stop()
        if self.decision is not None and self.decision.plan is not None:
            # It has driven on since the last odometry.
            self._pose = self.decision.plan.pose_at(self.decision.stamp, decision.stamp)
        self._command(decision)
        self._note(decision)

    def _command(self, decision: Decision) -> None:
        self._outputs.command(decision)
        self._held.begin()

    @property
    def connections(self) -> dict[str, int]:
        """Number of publishers of odometry, and of subscribers by topic, for diagnostics."""
        return {'odometry_publishers': self._odometry.publishers, **self._outputs.subscribers}

    @property
    def odometry_age(self) -> float | None:
        """Age of the latest odometry [s]; None before the first."""
        return self.watchdog.age(self._watch_time())

    def warnings(self) -> list[str]:
        """Warnings about inputs and outputs of the decisions, in sentences."""
        now = self._now()
        return [
            *self._tracks.warnings(now),
            *self._sensors.warnings(),
            *self._clock_watch.warnings(now),
            *(self._outputs.listeners.warnings() if self._begun else ()),
            *self.times.warnings(),
            *filter(None, [self._odometry.warning()]),
            *self._law.warnings,
        ]

    @property
    def waiting(self) -> str:
        """Inputs still missing before time 0, in a sentence; '' if none."""
        if self.road.waits:
            return 'Waiting for a road on the topic road.'
        return self.map.waiting or ('' if self._begun else self._outputs.listeners.lacking())

    @property
    def lacking(self) -> str:
        """Sentence on the input that the next decision waits for; '' if none is missing."""
        if self.waiting or self.decision is not None:
            return self.waiting
        if self._lacks_clock and self._now() == 0:
            return 'Waiting for /clock (use_sim_time).'
        return f'Waiting for odometry on {self._odometry.topic}.'

    def _on_odometry(self, data: bytes) -> None:
        self.map.try_again()
        if not self.active or self.waiting:
            return
        began, now = time.perf_counter_ns(), self._now()
        try:
            period = self._settings.control_period
            # A first command that is late looks like a longer delay.
            oldest = period if self._begun else 0.0
            reading, newest = self._odometry.newest(data, now, oldest, self._law.is_due)
            self._lacks_clock = (
                now == 0 and reading.stamp > self._settings.odom_timeout * NANOSECONDS
            )
            if self._lacks_clock and not self._begun:
                return
            pose, is_transformed = self._transforms.pose_of(reading, newest)
            stamp, before = reading.stamp, self.gate.newest
            arrival = self.gate.take(stamp, pose, now, self._settings)
        except OdometryError as error:
            self.gate.refuse(f'{error} {self._odometry.warning()}'.strip())
            self._brake()
            return
        if arrival is Arrival.IGNORED:
            return
        self.times.hear((now - stamp) / 1e6)
        self._outputs.name_robot(self._transforms.robot_frame(reading.child_frame_id))
        self.watchdog.end(self._watch_time())
        self._pose = pose.tolist()
        if arrival is Arrival.TIME_JUMPED_BACK and before is not None:
            self._begin_again(stamp, (before - stamp) / NANOSECONDS)
        blindness = self._sensors.note(stamp, pose)
        refused = '' if self._begun else reason_not_to_begin(self._settings, pose)
        self._trouble = refused or self._goals.cancelled or blindness or self.map.trouble(stamp)
        brakes = self.decision is not None and self.decision.braking
        if self.gate.fault or self._trouble or (brakes and self._held.left(self._settings)):
            self._brake()
            return
        try:
            is_due = self._law.is_due(stamp)
            sighting = self._sensors.at(stamp, pose) if is_due else None
            tracks = self._tracks.at(stamp, sighting) if is_due else ()
            decision = self._law.step(Observation(stamp, pose, tracks, sighting))
        except Exception as error:  # the robot must stop for any
            self._halt_for(f'The guidance law failed: {type(error).__name__}: {error}')
            return
        if decision is None:
            return
        sent = self._now()
        took = (sent - now) / NANOSECONDS
        is_late = took > period and decision.plan is not None
        last, gap = self.decision, 0.0
        if not is_late:
            if last is not None and last.plan is not None and not last.late:
                gap = self._held.age
            self._command(decision)
        self._expect_end(decision, now)
        step_ms = (time.perf_counter_ns() - began) / 1e6
        answer_ms, delay = (sent - stamp) / 1e6, self._settings.command_delay
        self.times.add(step_ms, answer_ms, period, delay, gap=gap, is_late=is_late)
        failure = ''
        try:
            decision = self._law.after_step(took if is_late else 0.0)
        except Exception as error:
            failure = f'The search of the grid failed: {type(error).__name__}: {error}'
        if is_late:
            self._node.get_logger().warning(decision.reason)
        if not self._begun:
            for each in self._law.warnings:
                self._node.get_logger().warning(each)
        self._begun = True
        if self.decision is None or decision.goal != self.decision.goal:
            self._scenery_changed = True
        phases = {**decision.phases, 'step': step_ms, 'odometry_to_command': answer_ms}
        keeps_pose = is_transformed or self._odometry.publishers > 1
        recorded = tuple(self._pose) if keeps_pose else None
        self._note(decision._replace(skipped=newest is not data, pose=recorded, phases=phases))
        if failure:
            self._halt_for(failure)
        self._use_slack(period - (time.perf_counter_ns() - began) / 1e9)

    def _expect_end(self, decision: Decision, now: int) -> None:
        end = self._law.ends_at
        # In lockstep it comes; the order of clock and odometry would be chance.
        if decision.finished or end is None or self._in_lockstep:
            return
        # The clock of odometry need not be that of this computer.
        self._over_at = now + end - decision.stamp
        self._end_timer.timer_period_ns = max(1, self._over_at - self._now()) + _LATEST_ODOMETRY
        self._end_timer.reset()

    def _on_end(self) -> None:
        self._end_timer.cancel()
        # Odometry of that instant comes first where it is there.
        self._odometry.drain()
        now, last = self._now(), self.decision
        is_over = self._goals.cancelled or (last is not None and last.finished)
        if not self.active or now <= self._over_at or is_over:
            return
        left = self._held.left(self._settings)
        if left and self._moves and last is not None and last.plan is None:
            # It brakes already.
            self._end_timer.timer_period_ns = math.ceil(left * NANOSECONDS)
            self._end_timer.reset()
        else:
            decision = self._law.halt(now, 'The final time has passed.', finished=True)
            self._command(decision)
            self._note(decision)

    def _use_slack(self, slack: float = math.inf) -> None:
        """Do deferred work after the command is out and before the next is due."""
        if self._scenery_changed:
            self.show()
        self._garbage.collect(slack)

    def _begin_again(self, stamp: int, back: float) -> None:
        """Begin the run again, since time has: it has jumped back by so much [s]."""
        said = f'time has jumped back by {back:.3f} s: the run begins again'
        self._node.get_logger().warning(said)
        self._law.reset()
        self._goals.end(said)
        self._begun = False
        self._transforms.forget_after(stamp)
        self._tracks.forget_after(stamp)
        self._sensors.forget()

    def _watch(self) -> None:
        if not self.active:
            return
        if self._garbage.overdue:
            self._use_slack()
        timeout = self._settings.odom_timeout
        if self.watchdog.is_longer_than(timeout, self._watch_time()):
            self._odometry.drain()
        if self.watchdog.goes_on(timeout, self._watch_time()):
            self.gate.fail(f'No usable odometry for more than {timeout} s (odom_timeout).')
        # In lockstep odometry comes whenever a control period is over.
        if self.gate.fault or (self._trouble and self._moves and not self._in_lockstep):
            self._brake()

    @property
    def _moves(self) -> bool:
        return self.decision is not None and bool(np.any(self.decision.twist))

    def _brake(self) -> None:
        """Stop for a fault or another reason, along the braking path if it is known."""
        if not self._held.left(self._settings):
            fault = self.gate.reason(self._settings)
            braking = self._held.can_brake(self._settings, is_lost=bool(fault))
            self._halt_for(fault or self._trouble, braking=braking)

    def _halt_for(self, reason: str, *, braking: bool = False) -> None:
        """Stop now, and again every control period while the reason lasts."""
        now, period = self._now(), self._settings.control_period * 1e9
        if self._halted_at is None or not 0 <= now - self._halted_at < period:
            self._halt(reason, braking=braking)
            self._halted_at = now

    def _note(self, decision: Decision) -> None:
        # The command has not waited for these.
        self._sensors.publish()
        self._tracks.publish()
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
