"""A topic or service of a node: its name, type, quality of service and notes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

if TYPE_CHECKING:
    from collections.abc import Callable

    from rclpy.node import Node
    from rclpy.publisher import Publisher
    from rclpy.subscription import Subscription


def publisher_names(node: Node, topic: str) -> list[str]:
    """Full names of the nodes that publish on a topic, once for each publisher, in order."""
    found = node.get_publishers_info_by_topic(topic)
    return sorted(f'{each.node_namespace.rstrip("/")}/{each.node_name}' for each in found)


@dataclass(frozen=True)
class Topic:
    """One topic or service of a node.

    Attributes:
        node: Name of the node.
        direction: Seen from the node.
        name: As the node uses it, before namespaces and remapping.
        type: Message or service class.
        notes: For the user.
        depth: Depth of its queue; 0 for a service.
        best_effort: Whether a subscription accepts best-effort publishers as well.
        latched: Whether late subscribers get the last message (transient local).
        repeats: Whether it only repeats the content of other topics; it is then not recorded.
    """

    node: str
    direction: Literal['in', 'out', 'srv']
    name: str
    type: Any
    notes: str
    depth: int = 10
    best_effort: bool = False
    latched: bool = False
    repeats: bool = False

    @property
    def qos(self) -> QoSProfile:
        """Quality of service."""
        return QoSProfile(
            depth=self.depth,
            reliability=ReliabilityPolicy.BEST_EFFORT
            if self.best_effort
            else ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL
            if self.latched
            else DurabilityPolicy.VOLATILE,
        )

    def publish_on(self, node: Node) -> Publisher:
        """Create a publisher."""
        return node.create_publisher(self.type, self.name, self.qos)

    def listen_on(
        self, node: Node, callback: Callable[[Any], None], *, raw: bool = False
    ) -> Subscription:
        """Create a subscription; one that is ``raw`` is given the bytes of each message."""
        return node.create_subscription(self.type, self.name, callback, self.qos, raw=raw)
