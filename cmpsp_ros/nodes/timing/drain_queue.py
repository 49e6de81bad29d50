"""Hearing what has come, before its turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.subscription import Subscription


def drain_queue(subscription: Subscription) -> None:
    """Call back now for all messages of a subscription that wait.

    Its executor, when it comes to them, finds them taken.
    """
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            subscription.callback(taken[0])
