"""Taking messages out of a queue before the executor does."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rclpy.subscription import Subscription


def drain_queue(subscription: Subscription) -> None:
    """Call back now for all messages of a subscription that wait.

    Its executor, when it comes to them, finds them taken.
    """
    for each in _waiting(subscription):
        subscription.callback(each)


def take_newest(subscription: Subscription) -> Any:
    """The newest message that waits, the others passed over; None where none does."""
    return [None, *_waiting(subscription)][-1]


def _waiting(subscription: Subscription) -> Iterator[Any]:
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            yield taken[0]
