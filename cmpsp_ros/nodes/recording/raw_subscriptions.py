"""Messages of many topics, in the order of their arrival."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.subscription import Subscription

if TYPE_CHECKING:
    from collections.abc import Container

_CROSSING = 2_000_000
"""Within this a message is in its queue after the middleware gave it its time [ns]."""


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


class _Unattended(CallbackGroup):
    """Keeps subscriptions out of the executor, but not their events.

    It would wake up for every message, which costs many times more than taking the message. That
    cost determines how much processor time a recorder takes from the nodes that it records.
    """

    def can_execute(self, entity: Any) -> bool:
        return not isinstance(entity, Subscription)

    def beginning_execution(self, entity: Any) -> bool:
        return self.can_execute(entity)

    def ending_execution(self, _entity: Any) -> None:
        """Events need nothing at their end."""


class RawSubscriptions:
    """The queues of subscriptions that no executor serves.

    They are polled in turn. A message that arrives meanwhile may be found while an earlier one, on
    a topic polled before, is not; it is kept until the next round, when both are there.

    Attributes:
        group: Callback group for the subscriptions.
    """

    def __init__(self) -> None:
        """Have no subscription yet."""
        self.group: CallbackGroup = _Unattended()
        self._subscriptions: dict[str, Subscription] = {}
        self._kept: list[Received] = []

    def add(self, name: str, subscription: Subscription) -> None:
        """Serve a subscription, which takes messages serialised."""
        self._subscriptions[name] = subscription

    def take(self, only: Container[str] | None = None, *, all_: bool = False) -> list[Received]:
        """Messages received since the last round, in the order of their arrival.

        Args:
            only: Names of topics; None for all.
            all_: There is no next round.
        """
        begun = time.time_ns()
        found = self._kept
        for name, subscription in self._subscriptions.items():
            if only is not None and name not in only:
                continue
            handle, kind = subscription.handle, subscription.msg_type
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
