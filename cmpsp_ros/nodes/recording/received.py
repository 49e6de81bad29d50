"""Received messages: taken in the order of their arrival, dated, and counted by topic."""

import time
from bisect import bisect_right, insort
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any, Final, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.time import Time
from rclpy.type_support import check_is_valid_msg_type
from rosgraph_msgs.msg import Clock

CLOCK: Final = '/clock'

# Maximum wait of a message for the next `/clock` [ns]; what is lost comes again within 3 s.
PATIENCE: Final = 4_000_000_000

# Time after which a message that the middleware has received is in its queue [ns].
_CROSSING = 2_000_000
_MAX_TICKS = 200_000

_LOST = rclpy_implementation.rcl_subscription_event_type_t.RCL_SUBSCRIPTION_MESSAGE_LOST

_COUNT, _NEWEST = ' messages', ' newest'


class Received(NamedTuple):
    """A received message, serialised."""

    received: int  # time of reception by the middleware, by the system clock [ns]
    # Time of publication, by the clock of the publisher's system [ns]; the time of reception if the
    # middleware does not know it.
    published: int
    topic: str
    raw: bytes


class _Queue(NamedTuple):
    """A subscription of the middleware, its type, and its count of losses."""

    handle: Any
    kind: Any
    losses: Any


class RawSubscriptions:
    """Subscriptions that no executor serves: to wake up costs more than to take a message.

    The queues are polled in turn. A message that arrives meanwhile is kept until the next
    round, when earlier ones on topics polled before are there, too.
    """

    def __init__(self, node: Node) -> None:
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
        """Topics of which messages could not be received so far, and their number."""
        for name, each in self._queues.items():
            with each.losses:
                status = each.losses.take_event()
            if status is not None and status.total_count > 0:
                yield name, status.total_count

    def take(self, only: Container[str] | None = None, *, all_: bool = False) -> list[Received]:
        """Messages since the last round, by arrival; `all_` if there is no next round."""
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
        # After the clock was set back, messages from the future are not waited for.
        late = range(begun - _CROSSING + 1, time.time_ns() + 1)
        self._kept = [] if all_ else [each for each in found if each.received in late]
        return found if all_ else [each for each in found if each.received not in late]


class SimulatedTime:
    """Simulated time by time of publication, and messages that wait for a later `/clock`.

    In lockstep much simulated time passes before a busy recorder receives a message.
    """

    def __init__(self) -> None:
        # Times of publication, and the value of `/clock` then [ns].
        self._ticks: list[tuple[int, int]] = []
        self._waiting: list[Received] = []

    @property
    def begun(self) -> bool:
        """True once any time is known."""
        return bool(self._ticks)

    def date(
        self, came: Iterable[Received], now: int, *, all_: bool = False
    ) -> list[tuple[int, Received]]:
        """Messages whose time is known by now, each with it [ns], in the order of publication.

        One received long before `now` [ns] does not wait any more: simulated time is
        paused. With `all_` nothing waits, and messages before the first `/clock` are dated
        0.
        """
        for each in came:
            self._waiting.append(each)
            if each.topic == CLOCK:
                stamp = Time.from_msg(deserialize_message(each.raw, Clock).clock).nanoseconds
                insort(self._ticks, (each.published, stamp), key=itemgetter(0))
        del self._ticks[:-_MAX_TICKS]
        newest = self._ticks[-1][0] if self._ticks else 0
        dated, waiting = list[Received](), list[Received]()
        for each in self._waiting:
            known = self.begun and (each.published <= newest or now - each.received > PATIENCE)
            (dated if known or all_ else waiting).append(each)
        self._waiting = waiting
        dated.sort(key=lambda each: each.published)
        return [(self._at(each.published), each) for each in dated]

    def _at(self, published: int) -> int:
        if not self.begun:
            return 0
        return self._ticks[max(bisect_right(self._ticks, published, key=itemgetter(0)) - 1, 0)][1]


@dataclass
class Written:
    """Messages of a topic in the bag: their number, and when the newest was published [ns]."""

    count: int = 0
    published: int = 0

    def add(self, published: int) -> None:
        """Count one more message, published at this time by its system's clock [ns]."""
        self.count += 1
        self.published = max(self.published, published)


ByTopic = defaultdict[str, Written]


def to_values(written: ByTopic) -> dict[str, object]:
    """Diagnostic values by key."""
    values: dict[str, object] = {}
    for topic, each in written.items():
        values |= {f'{topic}{_COUNT}': each.count, f'{topic}{_NEWEST}': each.published}
    return values


def from_values(values: Mapping[str, str]) -> ByTopic:
    """Read diagnostic values; any other topic has no messages."""
    topics = [key.removesuffix(_COUNT) for key in values if key.endswith(_COUNT)]
    return defaultdict(
        Written,
        {each: Written(int(values[each + _COUNT]), int(values[each + _NEWEST])) for each in topics},
    )
