"""Messages of many topics, in the order of their arrival."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.type_support import check_is_valid_msg_type

if TYPE_CHECKING:
    from collections.abc import Container, Iterator

    from rclpy.node import Node
    from rclpy.qos import QoSProfile

_CROSSING = 2_000_000
"""Within this a message is in its queue after the middleware gave it its time [ns]."""

_LOST = rclpy_implementation.rcl_subscription_event_type_t.RCL_SUBSCRIPTION_MESSAGE_LOST


class Received(NamedTuple):
    """A received message.

    Attributes:
        received: Time of reception by the middleware, by the system clock [ns].
        published: Time of publication, by the clock of the publisher's system [ns]; the time of
            reception if the middleware does not know it.
        topic: Name of its topic.
        raw: The message, serialised.
    """

    received: int
    published: int
    topic: str
    raw: bytes


class _Queue(NamedTuple):
    """Subscription of a topic as the middleware has it, its type, and its count of losses."""

    handle: Any
    kind: Any
    losses: Any


class RawSubscriptions:
    """Subscriptions that no executor serves: it would wake up for every message.

    That costs many times more than taking the message, and determines how much processor time a
    recorder takes from the nodes that it records.

    The queues are polled in turn. A message that arrives meanwhile may be found while an earlier
    one, on a topic polled before, is not; it is kept until the next round, when both are there.
    """

    def __init__(self, node: Node) -> None:
        """Have no subscription yet; the node is that of all that follow."""
        self._node = node
        self._queues: dict[str, _Queue] = {}
        self._kept: list[Received] = []

    def add(self, name: str, kind: Any, profile: QoSProfile) -> None:
        """Subscribe to a topic of a message class."""
        check_is_valid_msg_type(kind)
        with self._node.handle:
            handle = rclpy_implementation.Subscription(
                self._node.handle, kind, name, profile.get_c_qos_profile()
            )
        with handle:
            losses = rclpy_implementation.EventHandle(handle, _LOST)
        self._queues[name] = _Queue(handle, kind, losses)

    def close(self) -> None:
        """Unsubscribe."""
        for each in self._queues.values():
            each.losses.destroy_when_not_in_use()
            each.handle.destroy_when_not_in_use()
        self._queues.clear()

    def lost(self) -> Iterator[tuple[str, int]]:
        """Topics of which messages could not be received by now, and their number."""
        for name, each in self._queues.items():
            with each.losses:
                status = each.losses.take_event()
            if status is not None and status.total_count > 0:
                yield name, status.total_count

    def take(self, only: Container[str] | None = None, *, all_: bool = False) -> list[Received]:
        """Messages received since the last round, in the order of their arrival.

        Args:
            only: Names of topics; None for all.
            all_: There is no next round.
        """
        begun = time.time_ns()
        found = self._kept
        for name, (handle, kind, _) in self._queues.items():
            if only is not None and name not in only:
                continue
            with handle:
                while (taken := handle.take_message(kind, True)) is not None:
                    raw, info = taken
                    # Not every middleware knows when it received a message.
                    received = info['received_timestamp'] or begun - _CROSSING
                    published = info['source_timestamp'] or received
                    found.append(Received(received, published, name, raw))
        found.sort(key=lambda each: each.received)
        # Where the clock was set back meanwhile, what seems to come later is not waited for.
        late = range(begun - _CROSSING + 1, time.time_ns() + 1)
        self._kept = [] if all_ else [each for each in found if each.received in late]
        return found if all_ else [each for each in found if each.received not in late]
