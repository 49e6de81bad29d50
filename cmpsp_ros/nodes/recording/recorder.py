"""The recorder: topics of the graph into one bag."""

import time
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, cast

from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.clock import ROSClock
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from std_srvs.srv import Trigger

from cmpsp_ros.bags import BagError, BagWriter, UnknownTypeError
from cmpsp_ros.nodes.common.health import Health, Report
from cmpsp_ros.nodes.common.runtime import StartupError, run
from cmpsp_ros.nodes.common.topic import message_class, steady_timer
from cmpsp_ros.nodes.common.topics import RECORDER_FLUSH
from cmpsp_ros.nodes.recording import received
from cmpsp_ros.nodes.recording.options import read_options, topics_of_nodes
from cmpsp_ros.nodes.recording.qos import for_bag, hearing_all
from cmpsp_ros.programs import quick_exit

TAKE_PERIOD: Final = 0.05  # time between two rounds through the queues [s]

# Time between two flushes [s]; what came after the last is lost when the process is killed.
FLUSH_PERIOD: Final = 0.9
# Messages a topic may hold between two rounds; memory is taken only as they come.
QUEUE_DEPTH: Final = 10_000
# The end: nothing published before the signal has come for the first [s], or the second [s].
DRAIN_QUIET, DRAIN_LIMIT = 0.1, 2.0


@dataclass
class _Recorded:
    """A topic being recorded: profile of the subscription, and number of publishers."""

    profile: QoSProfile
    publisher_count: int


@dataclass
class _Loss:
    """Messages of a topic that could not be received, between two times of the recording [s]."""

    first: float
    last: float = 0.0
    count: int = 0

    def __str__(self) -> str:
        return f'{self.count} messages, between {self.first:.1f} and {self.last:.1f} s'


class Recorder(Node):
    """Records serialised messages until it is stopped, by reception or simulated publication.

    A later publisher whose quality of service does not fit is not recorded: a warning says so.
    Namespace and parameters of the command line override those given; or StartupError.
    """

    def __init__(
        self, namespace: str | None = None, parameters: Mapping[str, Any] | None = None
    ) -> None:
        given = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        super().__init__('recorder', namespace=namespace, parameter_overrides=given)
        self._options = read_options(self)
        self._topics: dict[str, _Recorded] = {}
        self._written: received.ByTopic = defaultdict(received.Written)
        self._left_out: set[str] = set()
        self._lost: dict[str, _Loss] = {}
        self._begun = self._looked = time.monotonic()
        self._queues = received.RawSubscriptions(self)
        try:
            self._bag = BagWriter(self._options.output, self._options.form)
        except BagError as error:
            raise StartupError(f'parameter output: {error}') from error
        self.failure: BagError | None = None
        self._simulated = received.SimulatedTime()
        # Simulated time may stand still; looking and taking must go on.
        for period, act in (
            (TAKE_PERIOD, self._take),
            (self._options.discovery_period, self._discover),
            (FLUSH_PERIOD, self._flush),
        ):
            steady_timer(self, period, partial(self._try, act))
        self.get_logger().info(f'recording to {self._bag.path}')
        self._try(self._discover)
        self.create_service(RECORDER_FLUSH.type, RECORDER_FLUSH.name, self._on_flush)
        self._health = Health(self, self._look)

    def stop(self) -> None:
        """Record messages still in transit, then close the bag; raises BagError."""
        try:
            if self.failure is None:
                self._drain()
        finally:
            self._bag.close()
            self._queues.close()
        for name, loss in sorted(self._lost.items()):
            self.get_logger().warning(
                f'{name}: {loss} of the recording, are not in the bag: they were published faster'
                ' than they could be received'
            )
        for name in sorted(self._options.listed - self._topics.keys()):
            self.get_logger().warning(f'{name} was to be recorded and had no publisher')
        self.get_logger().info(
            f'{self._bag.message_count} messages of {len(self._topics)} topics '
            f'recorded to {self._bag.path}'
        )

    def _try(self, act: Callable[[], object]) -> None:
        """Do something with the bag; if the disk refuses, end the process with that reason."""
        if self.failure is None:
            try:
                act()
            except BagError as error:
                self.failure = error

    def _look(self) -> Report:
        level, message = DiagnosticStatus.OK, f'Recording {len(self._topics)} topics.'
        if self._left_out:
            level = DiagnosticStatus.WARN
            message += f' Left out, as the log says: {", ".join(sorted(self._left_out))}.'
        if self._lost:
            level = DiagnosticStatus.WARN
            lost = ', '.join(f'{name}: {each}' for name, each in sorted(self._lost.items()))
            message += f' Lost messages: {lost}.'

        def values() -> dict[str, object]:
            return {
                'output': str(self._bag.path),
                'messages': self._bag.message_count,
                'topics': len(self._topics),
                **received.to_values(self._written),
            }

        return Report(level, message, (message,), values)

    def _on_flush(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._try(self._take)
        self._try(self._flush)
        self._health.publish()
        said = self.failure or f'{self._bag.message_count} messages are in the bag.'
        response.success, response.message = self.failure is None, str(said)
        return response

    def _discover(self) -> None:
        beside = topics_of_nodes(self) if self._options.own else frozenset[str]()
        for name, types in self.get_topic_names_and_types():
            if name in self._left_out or not self._options.want(name, types, beside):
                continue
            count, recorded = self.count_publishers(name), self._topics.get(name)
            if recorded is None and count > 0:
                self._begin(name, types, count)
            elif recorded is not None and count != recorded.publisher_count:
                recorded.publisher_count = count
                for each in self.get_publishers_info_by_topic(name):
                    fit, reason = qos_check_compatible(each.qos_profile, recorded.profile)
                    if fit == QoSCompatibility.ERROR:
                        who = f'{each.node_namespace.rstrip("/")}/{each.node_name}'
                        msg = f'{name} of {who} is not recorded: incompatible QoS: {reason}'
                        self.get_logger().warning(msg)

    def _begin(self, name: str, types: list[str], count: int) -> None:
        offered = [each.qos_profile for each in self.get_publishers_info_by_topic(name)]
        if not offered:
            return
        try:
            kind = _class_of(name, types)
            self._bag.topic(name, types[0], [for_bag(each) for each in offered])
        except UnknownTypeError as error:
            self._left_out.add(name)
            self.get_logger().warning(str(error))
            return
        profile = hearing_all(offered, depth=QUEUE_DEPTH)
        self._queues.add(name, kind, profile)
        self._topics[name] = _Recorded(profile, count)

    def _count_losses(self) -> None:
        """Count messages that a publisher's queue had no room for before they were sent here."""
        before, self._looked = self._looked, time.monotonic()
        for name, count in self._queues.lost():
            if name not in self._lost:
                self.get_logger().warning(f'messages of {name} come too fast: some are lost')
            loss = self._lost.setdefault(name, _Loss(before - self._begun))
            if count > loss.count:
                loss.last, loss.count = self._looked - self._begun, count

    def _take(self, *, ending: bool = False) -> int | None:
        """Write all messages received; returns the earliest time of publication among them [ns]."""
        simulated = cast('ROSClock', self.get_clock()).ros_time_is_active
        # All else is kept, up to its depth, by the middleware.
        waits = simulated and not self._simulated.begun and not ending
        came = self._queues.take((received.CLOCK,) if waits else None, all_=ending)
        if simulated:
            dated = self._simulated.date(came, time.time_ns(), all_=ending)
        else:
            dated = [(each.received, each) for each in came]
        for stamp, each in dated:
            self._bag.write(each.topic, stamp, each.raw)
            self._written[each.topic].add(each.published)
        return min((each.published for each in came), default=None)

    def _flush(self) -> None:
        self._count_losses()
        self._bag.flush()

    def _drain(self) -> None:
        """Continue until no message published before now has arrived for a while."""
        asked_at = time.time_ns()
        begun = heard = now = time.monotonic()
        while now - heard < DRAIN_QUIET and now - begun < DRAIN_LIMIT:
            time.sleep(DRAIN_QUIET / 10.0)
            published = self._take()
            now = time.monotonic()
            if published is not None and published <= asked_at:
                heard = now
        self._take(ending=True)
        self._count_losses()


def _class_of(topic: str, types: list[str]) -> Any:
    if len(types) != 1:
        msg = f'topic {topic} left out: its publishers disagree on its type: {", ".join(types)}'
        raise UnknownTypeError(msg)
    try:
        return message_class(types[0])
    except UnknownTypeError as error:
        raise UnknownTypeError(f'topic {topic} left out: {error}') from error


def record(parameters: Mapping[str, Any], namespace: str | None = None) -> int:
    """Record until SIGINT or SIGTERM, as the last thing a process does; returns exit code."""
    return run(partial(Recorder, namespace, parameters), name='recorder', args=[], outlasts=2.0)


def main() -> None:
    """Run the recorder as a process."""
    quick_exit(run(Recorder, name='recorder', outlasts=2.0))


if __name__ == '__main__':
    main()
