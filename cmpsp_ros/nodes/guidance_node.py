"""The guidance node: odometry in, velocity commands out, a reason for each."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import replace
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn

from cmpsp_ros.guidance.decision import Rung
from cmpsp_ros.guidance.goal_pose import GoalError, goal_of
from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.odometry import OdometryError, check_age, pose_of, stamp_of
from cmpsp_ros.guidance.time_jump import TimeJump
from cmpsp_ros.nodes.catch_up import catch_up
from cmpsp_ros.nodes.clock_watch import ClockWatch
from cmpsp_ros.nodes.compiling import prepare_aloud
from cmpsp_ros.nodes.garbage import GarbageCollection
from cmpsp_ros.nodes.guidance_messages import level_of
from cmpsp_ros.nodes.guidance_outputs import GuidanceOutputs
from cmpsp_ros.nodes.health import Health, Report, StepTimes
from cmpsp_ros.nodes.lifecycle import guard_change_state
from cmpsp_ros.nodes.obstacle_input import ObstacleInput
from cmpsp_ros.nodes.parameters import declare
from cmpsp_ros.nodes.realtime import Scheduling, check_cpu
from cmpsp_ros.nodes.rivals import TRUST, Rivals
from cmpsp_ros.nodes.road_messages import RoadInput
from cmpsp_ros.nodes.runtime import run
from cmpsp_ros.nodes.topics import GOAL_POSE, GUIDANCE_ODOM, RESET
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.errors import ParameterError, Problem
from cmpsp_ros.parameters.roads import lacks_road
from cmpsp_ros.parameters.settings import guidance_settings
from cmpsp_ros.parameters.table import is_of_ros

if TYPE_CHECKING:
    from geometry_msgs.msg import PoseStamped
    from nav_msgs.msg import Odometry
    from rclpy.lifecycle import LifecycleState
    from rclpy.parameter import Parameter
    from std_srvs.srv import Trigger

    from cmpsp_ros.guidance.decision import Decision
    from cmpsp_ros.guidance.settings import GuidanceSettings
    from cmpsp_ros.parameters.table import Values

_WATCH_PERIOD = 0.025
_GUIDED = 'Another node guides this robot: {}.'

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = 'unconfigured', 'inactive', 'active', 'finalized'
SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class GuidanceNode(LifecycleNode):
    """Feeds odometry to the guidance law and publishes what it decides.

    Whatever ends its activity - deactivation, shutdown, a signal, an exception, odometry that is
    lost or cannot be used - the last command it publishes is a zero twist.
    """

    def __init__(self) -> None:
        """Declare the parameters and, with `autostart`, go on to the active state."""
        super().__init__('guidance')
        guard_change_state(self)
        self._values: Values | None = None
        self._refusal = ''
        self._state = UNCONFIGURED
        self._garbage = GarbageCollection()
        self._begin()
        autostart = True
        try:
            self._values = declare(self, TABLE, 'guidance')
            autostart = self._values['autostart']
        except ParameterError as error:
            self._refusal = str(error)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._health = Health(self, self._report)
        if autostart and self.trigger_configure() == SUCCESS:
            self._activate_when_known()

    def stop(self) -> None:
        """Leave the active state, with a zero twist, before the process ends."""
        if self._state != FINALIZED:
            self.trigger_shutdown()

    def _activate_when_known(self) -> None:
        """Become active by itself: where others command this robot, once they have been heard."""
        if not self._rivals.others:
            self.trigger_activate()
            return

        def try_once() -> None:
            self.destroy_timer(timer)
            if self._state == INACTIVE:
                self.trigger_activate()

        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self.create_timer(TRUST, try_once, clock=steady)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Validate the whole set of parameters, load compiled code, open the topics."""
        try:
            if self._values is None:
                return self._refuse(self._refusal, 'configure')
            check_cpu(self._values)
            self._settings = guidance_settings(self._values)
            prepare_aloud(self._settings, self.get_logger())
        except Exception as error:  # rclpy would swallow it
            return self._refuse(str(error) or type(error).__name__, 'configure')
        self._refusal = ''
        self._law = GuidanceLaw(self._settings, time.perf_counter_ns)
        self._outputs = GuidanceOutputs(self, self._values, self._settings)
        self._rivals = Rivals(self, self._give_way)
        self._scheduling = Scheduling(self._values)
        self._obstacles = ObstacleInput(self, self._settings)
        self._road = RoadInput(self, self._values)
        self._inputs = (
            GUIDANCE_ODOM.listen_on(self, self._on_odometry),
            GOAL_POSE.listen_on(self, self._on_goal),
            self.create_service(RESET.type, RESET.name, self._on_reset),
            self.create_timer(_WATCH_PERIOD, self._watch),
        )
        # The first message of a process has rclpy look through all modules for who wrote it, which
        # takes longer than a control step may.
        self.get_logger().info('configured')
        self._garbage.settle()
        self._state = INACTIVE
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin: the next odometry is time 0. Not where another node guides this robot."""
        if rival := self._rivals.guiding:
            return self._refuse(_GUIDED.format(rival), 'activate')
        self._refusal = ''
        self._begin()
        self._law.reset()
        self._show()
        self._garbage.begin()
        for each in self._scheduling.apply():
            self.get_logger().warning(f'{each} The node goes on without.')
        self._rivals.begin()
        self._state = ACTIVE
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot and go silent."""
        self._halt(self._refusal or 'The guidance node was deactivated.')
        self._rest()
        self._state = INACTIVE
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the topics."""
        odometry, goals, service, timer = self._inputs
        self.destroy_subscription(odometry)
        self.destroy_subscription(goals)
        self.destroy_service(service)
        self.destroy_timer(timer)
        self._obstacles.close()
        self._road.close()
        self._outputs.close()
        self._rivals.close()
        self._garbage.end()
        self._state = UNCONFIGURED
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot if it is still guided."""
        if self._state == ACTIVE:
            self._halt('The guidance node is shutting down.')
            self._rest()
        self._state = FINALIZED
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Give back what an active node has taken, for the process may go on without it."""
        if self._state == ACTIVE:
            self._rest()
        self._garbage.end()
        super().destroy_node()

    def _begin(self) -> None:
        self._times = StepTimes()
        self._clock_watch = ClockWatch()
        self._heard_at: int | None = None
        self._silent_at: int | None = None
        self._time_jump = TimeJump()
        self._halted_at: int | None = None
        self._decision: Decision | None = None
        self._pose: list[float] = []

    def _rest(self) -> None:
        """Give back what an active node takes of Python, the system and the robot."""
        self._rivals.end()
        self._garbage.end()
        self._scheduling.restore()

    def _refuse(self, reason: str, transition: str) -> TransitionCallbackReturn:
        self._refusal = reason
        for line in reason.splitlines():
            self.get_logger().error(f'cannot {transition}: {line}')
        return FAILURE

    def _give_way(self, rival: str) -> None:
        """Leave the robot to a node that began before and had not been heard."""
        if self._state == ACTIVE:
            self._refusal = _GUIDED.format(rival)
            self.get_logger().error(self._refusal)
            self.trigger_deactivate()

    def _on_odometry(self, message: Odometry) -> None:
        if self._state != ACTIVE or self._road.waits:
            return
        began, now = time.perf_counter_ns(), self._now()
        try:
            pose, stamp = pose_of(message, self._settings.frame_id), stamp_of(message)
            check_age(stamp, now, self._settings.odom_timeout)
        except OdometryError as error:
            self._halt_for(str(error))
            return
        self._heard_at, self._pose = now, pose.tolist()
        self._notice_time(stamp)
        try:
            tracks = self._obstacles.at(stamp) if self._law.is_due(stamp) else ()
            decision = self._law.update(stamp, pose, tracks)
        except Exception as error:  # the robot must stop for any
            self._halt_for(f'The guidance law failed: {type(error).__name__}: {error}')
            return
        if decision is None:
            return
        self._outputs.command(decision)
        period, step_ms = self._settings.control_period, (time.perf_counter_ns() - began) / 1e6
        self._times.add(step_ms, period)
        if self._decision is None or decision.goal != self._decision.goal:
            self._scenery_changed = True
        self._note(replace(decision, phases={**decision.phases, 'step': step_ms}))
        self._use_slack(period - (time.perf_counter_ns() - began) / 1e9)

    def _on_goal(self, message: PoseStamped) -> None:
        if self._state != ACTIVE or self._road.waits:
            state = 'waiting for a road' if self._state == ACTIVE else self._state
            self.get_logger().warning(f'goal_pose is not heard: the node is {state}')
            return
        try:
            self._law.tell(*goal_of(message, self._settings.frame_id))
        except GoalError as error:
            self.get_logger().warning(f'goal_pose is refused: {error}')

    def _use_slack(self, slack: float = math.inf) -> None:
        """Do what can wait until the command is out, and the next is not yet due."""
        if self._scenery_changed:
            self._show()
        self._garbage.collect(slack)

    def _show(self) -> None:
        # Before a road came there is none to be seen.
        if not self._road.waits:
            ahead = None if self._decision is None else self._decision.goal
            self._outputs.show(self._law.task, ahead)
        self._scenery_changed = self._road.waits

    def _notice_time(self, stamp: int) -> None:
        """Begin the run again when time has: odometry fits the clock, but not what came before."""
        back = self._time_jump.back(stamp)
        if back > self._settings.odom_timeout:
            self.get_logger().warning(f'time has jumped back by {back:.3f} s: the run begins again')
            self._law.reset()
            self._obstacles.forget_after(stamp)

    def _watch(self) -> None:
        if self._state != ACTIVE:
            return
        if self._garbage.overdue:
            self._use_slack()
        if self._is_silent():
            odometry, *_ = self._inputs
            catch_up(odometry)
        if self._state != ACTIVE or not self._is_silent():
            self._silent_at = None
        elif self._silent_at is None:
            # A clock that jumps wakes this timer before the odometry that comes with it.
            self._silent_at = self._now()
        elif self._now() > self._silent_at:
            timeout = self._settings.odom_timeout
            self._halt_for(f'No usable odometry for more than {timeout} s (odom_timeout).')

    def _is_silent(self) -> bool:
        if self._heard_at is None:
            return False
        return self._now() - self._heard_at > self._settings.odom_timeout * 1e9

    def _halt_for(self, reason: str) -> None:
        """Stop now, and again every control period while the reason lasts."""
        now = self._now()
        period = self._settings.control_period * 1e9
        if self._halted_at is None or not 0 <= now - self._halted_at < period:
            self._halt(reason)
            self._halted_at = now

    def _halt(self, reason: str) -> None:
        decision = self._law.halt(self._now(), reason)
        if self._decision is not None and self._decision.plan is not None:
            # It has driven on since odometry was heard of last.
            self._pose = self._decision.plan.pose_at(self._decision.stamp, decision.stamp)
        self._outputs.command(decision)
        self._note(decision)

    def _note(self, decision: Decision) -> None:
        self._outputs.report(decision, self._pose)
        if self._decision is None or decision.rung != self._decision.rung:
            said = f'{decision.rung.name.lower()}: {decision.reason}'
            # rclpy refuses one place in the code that logs at two levels.
            if decision.rung == Rung.NOMINAL or decision.finished:
                self.get_logger().info(said)
            else:
                self.get_logger().warning(said)
        self._decision, self._halted_at = decision, None

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._begin()
        self._law.reset()
        response.success = True
        response.message = 'Time 0 is the next odometry.'
        return response

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._changed(parameters)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_parameters(self, parameters: list[Parameter]) -> None:
        self._values, self._settings = self._changed(parameters)
        if self._state == UNCONFIGURED:
            return
        self._law.reconfigure(self._settings)
        self._obstacles.settings = self._settings
        self._scenery_changed = True
        if self._state != ACTIVE:
            self._show()

    def _changed(self, parameters: list[Parameter]) -> tuple[Values, GuidanceSettings]:
        if self._values is None:
            raise ParameterError(Problem('guidance', 'a refused set of parameters', 'a restart'))
        changes = {each.name: each.value for each in parameters if not is_of_ros(each.name)}
        values = TABLE.reconfigure(self._values, changes)
        if lacks_road(values) and not lacks_road(self._values):
            raise ParameterError(Problem('road.points', 'nothing', 'a road, as there is one'))
        return values, guidance_settings(values)

    def _report(self) -> Report:
        decision, state = self._decision, self._state
        listeners = self._outputs.command_subscribers if state in {INACTIVE, ACTIVE} else 0
        if self._refusal:
            level, message = DiagnosticStatus.ERROR, self._refusal
        elif state != ACTIVE:
            level, message = DiagnosticStatus.OK, f'The node is {state}.'
        elif decision is None:
            level, message = DiagnosticStatus.WARN, 'Waiting for odometry.'
            if self._road.waits:
                message = 'Waiting for a road on the topic road.'
        else:
            level, message = level_of(decision), decision.reason
        if state == ACTIVE and (warnings := self._warnings()):
            level, message = max(level, DiagnosticStatus.WARN), ' '.join([message, *warnings])
        if state == ACTIVE and self._road.refusal:
            level, message = DiagnosticStatus.ERROR, f'{message} {self._road.refusal}'
        rung = None if decision is None else decision.rung

        def figures() -> dict[str, object]:
            values: dict[str, object] = {'state': state, 'command_subscribers': listeners}
            if decision is not None:
                values |= {'rung': decision.rung.name.lower(), 'time_left': decision.time_left}
            if self._heard_at is not None:
                values['odometry_age'] = (self._now() - self._heard_at) / 1e9
            return values | self._times.values()

        return Report(level, message, (level, state, rung, listeners), figures)

    def _warnings(self) -> list[str]:
        """What is wrong around the decisions, in sentences."""
        return [
            *self._rivals.warnings(),
            *self._obstacles.warnings(self._now()),
            *self._clock_watch.warnings(self._now()),
            *self._times.warnings(),
        ]

    def _now(self) -> int:
        return int(self.get_clock().now().nanoseconds)


def main() -> None:
    """Run the node until a signal."""
    sys.exit(run(GuidanceNode, name='guidance'))


if __name__ == '__main__':
    main()
