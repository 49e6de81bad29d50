"""A topic of a node, subscriptions that are read before their turn, and message classes."""

import re
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from cmpsp_ros.bags import UnknownTypeError

_NAME = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')


def quality(depth: int, *, reliable: bool, latched: bool) -> QoSProfile:
    """Profile of a topic; late subscribers get the last messages if it is latched."""
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


@dataclass(frozen=True)
class Topic:
    """One topic or service of a node."""

    node: str
    direction: Literal['in', 'out', 'srv']  # seen from the node
    name: str  # as the node uses it, before namespaces and remapping
    type: Any  # message or service class
    notes: str  # for the user
    depth: int = 10  # of its queue; 0 for a service
    best_effort: bool = False  # true if a subscription accepts best-effort publishers as well
    latched: bool = False  # true if late subscribers get the last message (transient local)
    # True if it only repeats the content of other topics; it is then not recorded.
    repeats: bool = False

    @property
    def qos(self) -> QoSProfile:
        """Quality of service."""
        return quality(self.depth, reliable=not self.best_effort, latched=self.latched)

    def publish_on(self, node: Node) -> Publisher:
        """Create a publisher."""
        return node.create_publisher(self.type, self.name, self.qos)

    def listen_on(
        self, node: Node, callback: Callable[[Any], None], *, raw: bool = False
    ) -> Subscription:
        """Create a subscription; one that is ``raw`` is given the bytes of each message."""
        return node.create_subscription(self.type, self.name, callback, self.qos, raw=raw)


class Listener:
    """Subscriptions and publishers of one input, closed together."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._subscriptions: list[Subscription] = []
        self._publishers: list[Publisher] = []

    def _publish_on(self, topic: Topic) -> Publisher:
        self._publishers.append(topic.publish_on(self._node))
        return self._publishers[-1]

    def close(self) -> None:
        """Close the topics."""
        for publisher in self._publishers:
            self._node.destroy_publisher(publisher)
        for each in self._subscriptions:
            self._node.destroy_subscription(each)

    def drain(self) -> None:
        """Run the callbacks now for all waiting messages; the executor finds the queues empty."""
        for each in self._subscriptions:
            for message in waiting(each):
                each.callback(message)


def steady_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Timer with a period [s] of a clock that never jumps: simulated time may stand still."""
    return node.create_timer(period, callback, clock=Clock(clock_type=ClockType.STEADY_TIME))


def watch_time(node: Node) -> int:
    """Time to measure silence by [ns]: simulated, or steady, since the system's may be set."""
    clock = node.get_clock()
    return int(clock.now().nanoseconds) if clock.ros_time_is_active else time.monotonic_ns()


def watch_timer(node: Node, period: float, callback: Callable[[], None]) -> Timer:
    """Timer with a period [s] of `watch_time`: system time that is set back would stop it."""
    if node.get_clock().ros_time_is_active:
        return node.create_timer(period, callback)
    return steady_timer(node, period, callback)


def waiting(subscription: Subscription) -> Iterator[Any]:
    """Take the waiting messages of a subscription."""
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            yield taken[0]


def publisher_names(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, once for each publisher, in order."""
    found = node.get_publishers_info_by_topic(topic)
    return sorted(f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in found)


def message_class(name: str) -> Any:
    """Class of a type, such as `nav_msgs/msg/Odometry`; raises UnknownTypeError without it."""
    match = _NAME.fullmatch(name)
    # A bag may name any package; only one of messages is imported.
    if match and _has_messages(match[1]):
        found = getattr(import_module(f'{match[1]}.msg'), match[2], None)
        if found is not None:
            return found
    raise UnknownTypeError(f'found type {name!r}, wanted one that is installed here')


def _has_messages(package: str) -> bool:
    spec = find_spec(package)
    folders = (spec and spec.submodule_search_locations) or ()
    return any((Path(folder) / 'msg' / '__init__.py').is_file() for folder in folders)
