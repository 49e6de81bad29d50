"""The guidance node: odometry in, velocity commands out, a reason for each."""

from functools import partial

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from cmpsp_ros.guidance import GuidanceSettings, prepare
from cmpsp_ros.guidance.mission import infeasibility_warnings
from cmpsp_ros.nodes.common.health import Health, Report
from cmpsp_ros.nodes.common.parameters import declare, event_of
from cmpsp_ros.nodes.common.runtime import overrides, run
from cmpsp_ros.nodes.common.topic import steady_timer
from cmpsp_ros.nodes.common.topics import PARAMETERS, RESET
from cmpsp_ros.nodes.guidance.command_arbitration import TRUST, CommandArbiter
from cmpsp_ros.nodes.guidance.diagnostics import report_on
from cmpsp_ros.nodes.guidance.lifecycle import (
    ACTIVE,
    FINALIZED,
    INACTIVE,
    UNCONFIGURED,
    LifecycleBond,
    guard_change_state,
)
from cmpsp_ros.nodes.guidance.loop import GuidanceLoop
from cmpsp_ros.nodes.guidance.timing import (
    GarbageCollection,
    LateCompilations,
    Scheduling,
    check_cpu,
    prepare_aloud,
)
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    Problem,
    Values,
    course_problems,
    guidance_settings,
    lacks_road,
    plausibility_warnings,
)
from cmpsp_ros.programs import quick_exit

_GUIDED = 'Another node guides this robot: {}.'

SUCCESS, FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE


class GuidanceNode(LifecycleNode):
    """Lifecycle node that guides the robot while active; its last command is a zero twist."""

    def __init__(self) -> None:
        super().__init__('guidance')
        guard_change_state(self)
        self._values: Values | None = None
        self._refusal = ''
        self._state = UNCONFIGURED
        self._garbage = GarbageCollection()
        self._late = LateCompilations()
        self._said = ''
        self._bond = LifecycleBond(self)
        self._given = set(overrides(self))
        try:
            self._values = declare(self, 'guidance')
        except ParameterError as error:
            self._refusal = str(error)
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_parameters)
        self._health = Health(self, self._report)
        self.create_service(RESET.type, RESET.name, self._on_reset)
        autostart = self._values is not None and self._values['autostart']
        if (autostart or self._refusal) and self.trigger_configure() == SUCCESS:
            self._activate_when_known()

    def stop(self) -> None:
        """Leave the active state, with a zero twist, before the process ends."""
        if self._state != FINALIZED:
            self.trigger_shutdown()

    def _activate_when_known(self) -> None:
        """Activate automatically; if other nodes command this robot, after their discovery."""
        if not self._arbiter.others:
            self.trigger_activate()
            return

        def try_once() -> None:
            self.destroy_timer(timer)
            if self._state == INACTIVE:
                self.trigger_activate()

        timer = steady_timer(self, TRUST, try_once)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Validate the whole set of parameters, load compiled code, open the topics."""
        try:
            if self._values is None:
                return self._refuse(self._refusal, 'configure')
            check_cpu(self._values)
            settings = guidance_settings(self._values)
            prepare_aloud(partial(prepare, settings), self.get_logger())
            self._loop = GuidanceLoop(self, self._values, settings, self._garbage)
        except Exception as error:  # rclpy would swallow it
            return self._refuse(str(error) or type(error).__name__, 'configure')
        self._refusal = ''
        start = settings.start_pose
        self._foretold = []
        if start is not None:
            self._foretold = infeasibility_warnings(settings, settings.world, start[:2])
        self._arbiter = CommandArbiter(self, self._give_way)
        self._scheduling = Scheduling(self._values)
        self._parameters_out = PARAMETERS.publish_on(self)
        self._parameters_out.publish(event_of(self))
        # The first message of a process has rclpy look through all modules for who wrote it, which
        # takes longer than a control step may.
        self.get_logger().info('configured')
        self._garbage.settle()
        self._state = INACTIVE
        for each in self._remarks():
            self.get_logger().warning(each)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin: the next odometry is time 0. Not where another node guides this robot."""
        if missing := self._missing():
            return self._refuse('\n'.join(missing), 'activate')
        if rival := self._arbiter.guiding:
            return self._refuse(_GUIDED.format(rival), 'activate')
        self._refusal = ''
        self._loop.reset()
        self._loop.show()
        self._garbage.begin()
        for each in self._scheduling.apply():
            self.get_logger().warning(f'{each} The node goes on without.')
        self._arbiter.begin()
        self._late.begin()
        self._bond.begin()
        self._state, self._loop.active = ACTIVE, True
        self.get_logger().info('active')
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot and go silent."""
        self._rest(self._refusal or 'The guidance node was deactivated.')
        self._state = INACTIVE
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Close the topics."""
        self._loop.close()
        self.destroy_publisher(self._parameters_out)
        self._arbiter.close()
        self._garbage.end()
        self._state = UNCONFIGURED
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stop the robot if it is still guided."""
        if self._state == ACTIVE:
            self._rest('The guidance node is shutting down.')
        self._state = FINALIZED
        return super().on_shutdown(state)

    def destroy_node(self) -> None:
        """Release the resources of an active node, for the process may go on without it."""
        if self._state == ACTIVE:
            self._give_back()
        self._garbage.end()
        super().destroy_node()

    def _rest(self, reason: str) -> None:
        self._loop.rest(reason)
        self._give_back()

    def _give_back(self) -> None:
        """Release the resources of an active node: interpreter, system and robot."""
        self._arbiter.end()
        self._late.end()
        self._bond.end()
        self._garbage.end()
        self._scheduling.restore()

    def _refuse(self, reason: str, transition: str) -> TransitionCallbackReturn:
        self._refusal = reason
        for line in reason.splitlines():
            self.get_logger().error(f'cannot {transition}: {line}')
        return FAILURE

    def _missing(self) -> list[str]:
        """Missing parts of the course, in sentences; the robot is not driven without them."""
        if self._values is None:
            return []
        return [f'No course: {each}' for each in course_problems(self._values, self._given)]

    def _remarks(self) -> list[str]:
        return [*self._missing(), *plausibility_warnings(self._values or {}), *self._foretold]

    def _give_way(self, rival: str) -> None:
        """Leave the robot to a node that began earlier but was discovered late."""
        if self._state == ACTIVE:
            self._refusal = _GUIDED.format(rival)
            self.get_logger().error(self._refusal)
            self.trigger_deactivate()

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._is_configured
        response.message = f'The node is {self._state}.'
        if self._is_configured:
            self._loop.reset()
            response.message = 'Time 0 is the next odometry.'
        return response

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        try:
            self._checked = self._changed(parameters)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_parameters(self, parameters: list[Parameter]) -> None:
        self._values, settings = self._checked
        self._given.update(each.name for each in parameters)
        if self._is_configured:
            self._loop.take(settings)
            self._parameters_out.publish(event_of(self, parameters))

    def _changed(self, parameters: list[Parameter]) -> tuple[Values, GuidanceSettings]:
        if self._values is None:
            raise ParameterError(Problem('guidance', 'a refused set of parameters', 'a restart'))
        changes = {each.name: each.value for each in parameters}
        values = TABLE.reconfigure(self._values, changes)
        if lacks_road(values) and not lacks_road(self._values):
            raise ParameterError(Problem('road.points', 'nothing', 'a road, as there is one'))
        return values, guidance_settings(values)

    def _report(self) -> Report:
        if not self._is_configured:
            return report_on(self._state, self._refusal, None)
        if self._state == INACTIVE:
            return report_on(self._state, self._refusal, self._loop, self._remarks())
        self._say(self._loop.lacking)
        warnings = [*self._arbiter.warnings(), *plausibility_warnings(self._values or {})]
        errors = self._late.errors()
        return report_on(self._state, self._refusal, self._loop, warnings, errors)

    def _say(self, lacking: str) -> None:
        """Log what the node waits for, once."""
        if lacking and lacking != self._said:
            self.get_logger().info(lacking)
        self._said = lacking

    @property
    def _is_configured(self) -> bool:
        return self._state in {INACTIVE, ACTIVE}


def main() -> None:
    """Run the node until a signal."""
    quick_exit(run(GuidanceNode, name='guidance'))


if __name__ == '__main__':
    main()
