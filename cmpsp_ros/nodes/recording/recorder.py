"""The recorder: topics of the graph into one bag, with the parameters of all nodes."""

from __future__ import annotations

import time
from collections import defaultdict
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, cast

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import Clock as RclpyClock
from rclpy.clock import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSCompatibility, qos_check_compatible

from cmpsp_ros.bags.errors import BagError, UnknownTypeError
from cmpsp_ros.bags.writer import BagWriter
from cmpsp_ros.nodes.common.health import Health, Report
from cmpsp_ros.nodes.common.message_types import message_class
from cmpsp_ros.nodes.common.qos import for_bag, hearing_all
from cmpsp_ros.nodes.common.runtime import StartupError, run
from cmpsp_ros.nodes.common.topics import RECORDER_FLUSH
from cmpsp_ros.nodes.recording.options import read_options, topics_of_nodes
from cmpsp_ros.nodes.recording.parameter_watch import ParameterWatch
from cmpsp_ros.nodes.recording.raw_subscriptions import RawSubscriptions
from cmpsp_ros.nodes.recording.simulated_time import TOPIC, SimulatedTime
from cmpsp_ros.nodes.recording.written import ByTopic, Written, to_values
from cmpsp_ros.quick_exit import quick_exit

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.clock import ROSClock
    from rclpy.event_handler import QoSMessageLostInfo
    from rclpy.subscription import Subscription
    from std_srvs.srv import Trigger

TAKE_PERIOD = 0.01
"""Time between two rounds through the queues [s]."""

FLUSH_PERIOD = 0.5
"""Time between two flushes [s]; what came after the last is lost when the process is killed."""

QUEUE_DEPTH = 10_000
"""Messages a topic may hold between two rounds; memory is taken only as they come."""

DRAIN_QUIET, DRAIN_LIMIT = 0.1, 2.0
"""The end: nothing published before the signal has come for the first [s], or the second [s]."""


@dataclass
class _Recorded:
    """A topic being recorded."""

    subscription: Subscription
    publisher_count: int


class Recorder(Node):
    """Records until it is stopped.

    Serialised messages are copied from the middleware's queues to the bag. A message's time is that
    of its reception; in simulated time that of its publication. A later publisher whose quality of
    service does not fit the existing subscription is not recorded: a warning says so.

    Args:
        namespace: Namespace; that of the command line when absent.
        parameters: Parameters, before those of the command line.

    Raises:
        StartupError: A parameter is wrong, or `output` exists or cannot be created.
    """

    def __init__(
        self, namespace: str | None = None, parameters: Mapping[str, Any] | None = None
    ) -> None:
        given = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        super().__init__('recorder', namespace=namespace, parameter_overrides=given)
        self._options = read_options(self)
        self._topics: dict[str, _Recorded] = {}
        self._written: ByTopic = defaultdict(Written)
        self._left_out: set[str] = set()
        self._lost: dict[str, int] = {}
        self._queues = RawSubscriptions()
        try:
            self._bag = BagWriter(self._options.output, self._options.form)
        except BagError as error:
            msg = f'parameter output: {error}'
            raise StartupError(msg) from error
        self._broken = False
        self._simulated = SimulatedTime()
        self._parameter_watch = ParameterWatch(self, self._bag.set_parameters)
        # Simulated time may stand still; looking and taking must go on.
        steady = RclpyClock(clock_type=ClockType.STEADY_TIME)
        self._taking = self.create_timer(TAKE_PERIOD, self._take, clock=steady)
        self.create_timer(self._options.discovery_period, self._discover, clock=steady)
        self.create_timer(FLUSH_PERIOD, self._flush, clock=steady)
        self.get_logger().info(f'recording to {self._bag.path}')
        self._discover()
        self.create_service(RECORDER_FLUSH.type, RECORDER_FLUSH.name, self._on_flush)
        self._health = Health(self, self._look)

    def stop(self) -> None:
        """Record messages still in transit, then close the bag.

        Raises:
            BagError: The bag could not be closed, or not with all messages.
        """
        try:
            if not self._broken:
                self._drain()
        finally:
            self._bag.close()
        for name in sorted(self._options.listed - self._topics.keys()):
            self.get_logger().warning(f'{name} was to be recorded and had no publisher')
        self.get_logger().info(
            f'{self._bag.message_count} messages of {len(self._topics)} topics '
            f'recorded to {self._bag.path}'
        )

    def _look(self) -> Report:
        known = self._parameter_watch.known
        level, message = DiagnosticStatus.OK, f'Recording {len(self._topics)} topics.'
        if self._left_out:
            level = DiagnosticStatus.WARN
            message += f' Left out, as the log says: {", ".join(sorted(self._left_out))}.'
        if self._lost:
            level = DiagnosticStatus.WARN
            lost = ', '.join(f'{count} of {name}' for name, count in sorted(self._lost.items()))
            message += f' Lost messages: {lost}.'

        def values() -> dict[str, object]:
            return {
                'output': str(self._bag.path),
                'messages': self._bag.message_count,
                'topics': len(self._topics),
                'parameters_of': ', '.join(known),
                **to_values(self._written),
            }

        return Report(level, message, (message, known), values)

    def _on_flush(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._take()
        self._flush()
        self._health.publish()
        count = self._bag.message_count
        response.success, response.message = True, f'{count} messages are in the bag.'
        return response

    def _discover(self) -> None:
        beside = topics_of_nodes(self) if self._options.own else frozenset[str]()
        for name, types in self.get_topic_names_and_types():
            if name in self._left_out or not self._options.want(name, beside):
                continue
            count = self.count_publishers(name)
            recorded = self._topics.get(name)
            if recorded is None:
                if count > 0:
                    self._begin(name, types, count)
            elif count != recorded.publisher_count:
                recorded.publisher_count = count
                self._check_publishers(name, recorded.subscription)
        self._parameter_watch.poll()

    def _begin(self, name: str, types: list[str], count: int) -> None:
        """Subscribe to a topic; one that cannot be recorded is left out, with a warning."""
        publishers = self.get_publishers_info_by_topic(name)
        if not publishers:
            return
        try:
            kind = _class_of(name, types)
            self._bag.topic(name, types[0], [for_bag(each.qos_profile) for each in publishers])
        except UnknownTypeError as error:
            self._left_out.add(name)
            self.get_logger().warning(str(error))
            return
        except BagError:
            self._broken = True
            raise
        subscription = self.create_subscription(
            kind,
            name,
            lambda _: None,
            hearing_all((each.qos_profile for each in publishers), depth=QUEUE_DEPTH),
            callback_group=self._queues.group,
            event_callbacks=SubscriptionEventCallbacks(
                use_default_callbacks=False, message_lost=partial(self._on_lost, name)
            ),
            raw=True,
        )
        self._topics[name] = _Recorded(subscription, count)
        self._queues.add(name, subscription)

    def _on_lost(self, name: str, what: QoSMessageLostInfo) -> None:
        """Say which messages a publisher's queue had no room for before they were sent here."""
        self._lost[name] = what.total_count
        self.get_logger().warning(
            f'{what.total_count_change} messages of {name} are not in the bag: '
            'they were published faster than they could be received'
        )

    def _check_publishers(self, name: str, subscription: Subscription) -> None:
        for each in self.get_publishers_info_by_topic(name):
            fit, reason = qos_check_compatible(each.qos_profile, subscription.qos_profile)
            if fit == QoSCompatibility.ERROR:
                who = f'{each.node_namespace.rstrip("/")}/{each.node_name}'
                self.get_logger().warning(
                    f'{name} of {who} is not recorded: incompatible QoS: {reason}'
                )

    def _take(self, *, ending: bool = False) -> int | None:
        """Write all messages received.

        Args:
            ending: Do not wait for simulated time to begin any more.

        Returns:
            Earliest time of publication among the messages [ns], None when there are none.
        """
        simulated = cast('ROSClock', self.get_clock()).ros_time_is_active
        # All else is kept, up to its depth, by the middleware.
        waits = simulated and not self._simulated.begun and not ending
        came = self._queues.take((TOPIC,) if waits else None, all_=ending)
        if simulated:
            dated = self._simulated.date(came, time.time_ns(), all_=ending)
        else:
            dated = [(each.received, each) for each in came]
        try:
            for stamp, each in dated:
                self._bag.write(each.topic, stamp, each.raw)
                self._written[each.topic].add(each.published)
        except BagError:
            self._broken = True
            raise
        for each in came:
            if each.topic == '/parameter_events':
                self._parameter_watch.hear(each.raw)
        self._parameter_watch.caught_up()
        return min((each.published for each in came), default=None)

    def _flush(self) -> None:
        try:
            self._bag.flush()
        except BagError:
            self._broken = True
            raise

    def _drain(self) -> None:
        """Continue until no message published before now has arrived for a while."""
        self._taking.cancel()
        asked_at = time.time_ns()
        begun = heard = time.monotonic()
        now = begun
        while now - heard < DRAIN_QUIET and now - begun < DRAIN_LIMIT:
            # Answers about parameters and the simulated clock come in here.
            if self.executor is not None:
                self.executor.spin_once(timeout_sec=TAKE_PERIOD)
            published = self._take()
            now = time.monotonic()
            if published is not None and published <= asked_at:
                heard = now
        self._take(ending=True)
        self._parameter_watch.finish()


def _class_of(topic: str, types: list[str]) -> Any:
    if len(types) != 1:
        msg = f'topic {topic} left out: its publishers disagree on its type: {", ".join(types)}'
        raise UnknownTypeError(msg)
    try:
        return message_class(types[0])
    except UnknownTypeError as error:
        msg = f'topic {topic} left out: {error}'
        raise UnknownTypeError(msg) from error


def record(parameters: Mapping[str, Any], namespace: str | None = None) -> int:
    """Record until SIGINT or SIGTERM, as the last thing a process does.

    Args:
        parameters: Of the recorder, by name.
        namespace: In which names of topics are meant.

    Returns:
        Exit code: 0 after a signal, 1 when recording came to an end by itself.

    """
    return _run(partial(Recorder, namespace, parameters), args=[])


def _run(make_node: Callable[[], Recorder], args: Sequence[str] | None = None) -> int:
    # The default one would call back for every message, in spite of the queues.
    return run(make_node, name='recorder', args=args, make_executor=SingleThreadedExecutor)


def main() -> None:
    """Run the recorder as a process."""
    quick_exit(_run(Recorder))


if __name__ == '__main__':
    main()
