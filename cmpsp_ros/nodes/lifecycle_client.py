"""A client outside of the nodes: it watches a run, and changes lifecycle states."""

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from types import TracebackType
from typing import Self

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.experimental import EventsExecutor
from rclpy.node import Node

from cmpsp_ros.nodes.common.interruptions import interruptions_held
from cmpsp_ros.nodes.common.topics import RECORDER_FLUSH
from cmpsp_ros.nodes.recording.received import ByTopic, from_values

_WAKE_PERIOD = 0.02


@dataclass
class GuidanceStatus:
    """Latest diagnostics and decision of a guidance node, as text, empty before the first."""

    health: dict[str, str] = field(default_factory=dict)
    level: bytes = DiagnosticStatus.STALE
    message: str = ''
    decision: dict[str, str] = field(default_factory=dict)
    reason: str = ''
    decisions: int = 0
    commands: int = 0  # decisions that were sent, and not withdrawn since they were late


class LifecycleClient:
    """Listens to the guidance node of each robot and activates it; a context manager.

    It has a ROS context of its own, and is spun only while it waits. `on_decision` is called
    with the namespace of a robot and each decision received.
    """

    def __init__(self, domain_id: int, namespaces: Iterable[str] = ('',)) -> None:
        self.robots = {each: GuidanceStatus() for each in namespaces}
        self.on_decision: Callable[[str, GuidanceStatus], None] = lambda _namespace, _seen: None
        self._context = Context()
        self._context.init(domain_id=domain_id)
        self._node = Node('observer', context=self._context, start_parameter_services=False)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        listen = self._node.create_subscription
        listen(DiagnosticArray, '/diagnostics', self._on_diagnostics, 10)
        name = RECORDER_FLUSH.name.replace('~', '/recorder')
        self._flush = self._node.create_client(RECORDER_FLUSH.type, name)
        self._transitions = {}
        self._written: dict[str, str] = {}
        for each in self.robots:
            node = f'{each}/guidance'
            listen(DiagnosticArray, f'{node}/decision', partial(self._on_decision, each), 100)
            client = self._node.create_client(ChangeState, f'{node}/change_state')
            self._transitions[each] = client

    @property
    def seen(self) -> GuidanceStatus:
        """Status of the first robot."""
        return next(iter(self.robots.values()))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def wait_until(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Listen until a condition holds; True if it did within the time [s]."""
        end = time.monotonic() + timeout
        while not condition():
            if time.monotonic() > end:
                return False
            with interruptions_held():
                self._executor.spin_once(timeout_sec=_WAKE_PERIOD)
        return True

    def recorded(self, timeout: float, check: Callable[[], None] = lambda: None) -> ByTopic:
        """Messages that the recorder has written, by topic; TimeoutError without an answer [s]."""
        end = time.monotonic() + timeout

        def when(condition: Callable[[], bool]) -> bool:
            check()
            return condition()

        if self.wait_until(partial(when, self._flush.service_is_ready), timeout):
            self._written = {}
            self._flush.call_async(RECORDER_FLUSH.type.Request())
            left = end - time.monotonic()
            if self.wait_until(partial(when, lambda: bool(self._written)), left):
                return from_values(self._written)
        raise TimeoutError(f'the recorder did not answer within {timeout:.0f} s')

    def configure(
        self,
        timeout: float,
        namespace: str = '',
        still_compiles: Callable[[], bool] = lambda: False,
    ) -> bool:
        """Configure the guidance node of a robot; True if it agreed, or TimeoutError.

        After each timeout [s], `still_compiles` decides on further waiting.
        """
        transition = Transition.TRANSITION_CONFIGURE
        return self._change_state(transition, timeout, namespace, still_compiles)

    def activate(self, timeout: float, namespace: str = '') -> bool:
        """Activate the guidance node of a robot; as `configure`."""
        return self._change_state(Transition.TRANSITION_ACTIVATE, timeout, namespace)

    def deactivate(self, timeout: float, namespace: str = '') -> bool:
        """Deactivate the guidance node of a robot; as `configure`."""
        return self._change_state(Transition.TRANSITION_DEACTIVATE, timeout, namespace)

    def _change_state(
        self,
        transition: int,
        timeout: float,
        namespace: str,
        goes_on: Callable[[], bool] = lambda: False,
    ) -> bool:
        end, client = time.monotonic() + timeout, self._transitions[namespace]
        if self.wait_until(client.service_is_ready, timeout):
            request = ChangeState.Request(transition=Transition(id=transition))
            future = client.call_async(request)
            left = end - time.monotonic()
            while not self.wait_until(future.done, left):
                if not goes_on():
                    break
                left = timeout
            else:
                return bool(future.result().success)
        raise TimeoutError(
            f'the guidance node did not answer within {timeout:.0f} s; if it was compiling,'
            ' run `cmpsp warmup` first'
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == '/recorder: recorder':
                self._written = {each.key: each.value for each in status.values}
            seen = self.robots.get(status.name.removesuffix('/guidance: guidance'))
            if seen is not None:
                seen.health = {each.key: each.value for each in status.values}
                seen.level, seen.message = status.level, status.message

    def _on_decision(self, namespace: str, message: DiagnosticArray) -> None:
        seen = self.robots[namespace]
        status = message.status[0]
        seen.decision = {each.key: each.value for each in status.values}
        seen.reason = status.message
        seen.decisions += 1
        seen.commands += 'late' not in seen.decision
        self.on_decision(namespace, seen)
