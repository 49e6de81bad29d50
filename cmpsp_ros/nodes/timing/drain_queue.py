"""Taking messages out of a queue before the executor does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.subscription import Subscription


def drain_queue(subscription: Subscription) -> None:
    """Run the callback now for all waiting messages of a subscription.

    The executor then finds the queue empty.
    """
    for each in _waiting(subscription):
        subscription.callback(each)


def take_newest(subscription: Subscription) -> Any:
    """The newest waiting message, dropping the others; None if there is none."""
    return [None, *_waiting(subscription)][-1]


def _waiting(subscription: Subscription) -> Iterator[Any]:
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            yield taken[0]
