"""A subscription that is heard before everything else of its node."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rclpy.context import Context
    from rclpy.subscription import Subscription

_NS = 1e9


class Prompt:
    """Waits for one subscription alone.

    An executor waits for everything that a node has, and makes the set of it anew each time that
    it wakes: that takes it longer than the middleware takes to bring the message. The executor
    may go on to serve the same subscription; a message goes to whoever takes it first.
    """

    def __init__(
        self, subscription: Subscription, context: Context, *, after: Sequence[Subscription] = ()
    ) -> None:
        """Take the subscription of a node.

        Args:
            subscription: The one to wait for.
            context: Of the node.
            after: Those whose messages go before, if they have come by then.
        """
        self._subscription, self._after = subscription, after
        self._wait_set = _rclpy.WaitSet(1, 0, 0, 0, 0, 0, context.handle)

    def hear(self, timeout: float) -> None:
        """Wait for a message, at most so long [s], and have the subscription's callback take it."""
        handle, taken = self._subscription.handle, None
        with handle:
            self._wait_set.clear_entities()
            self._wait_set.add_subscription(handle)
            self._wait_set.wait(max(0, round(timeout * _NS)))
            taken = handle.take_message(self._subscription.msg_type, self._subscription.raw)
        if taken is None:
            return
        for each in self._after:
            _take_all(each)
        self._subscription.callback(taken[0])


def _take_all(subscription: Subscription) -> None:
    handle = subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, subscription.raw)) is not None:
            subscription.callback(taken[0])
