"""Times of publication of messages, in simulated time."""

from __future__ import annotations

from bisect import bisect_right
from typing import TYPE_CHECKING

from rclpy.serialization import deserialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

if TYPE_CHECKING:
    from collections.abc import Iterable

    from cmpsp_ros.nodes.recording.raw_subscriptions import Received

TOPIC = '/clock'

PATIENCE = 4_000_000_000
"""How long a message waits for `/clock` to go on [ns]; what is lost comes again within 3 s."""

_KEPT = 100_000


class SimulatedTime:
    """Times of `/clock` and of their publication, and messages that wait for later ones.

    In lockstep much simulated time passes before a busy recorder receives a message, so the time of
    publication counts. A message published after the latest known `/clock` has to wait, because a
    later `/clock` may still arrive.
    """

    def __init__(self) -> None:
        """Begin without any time."""
        self._published: list[int] = []
        self._told: list[int] = []
        self._waiting: list[Received] = []

    @property
    def begun(self) -> bool:
        """Whether any time is known."""
        return bool(self._told)

    def date(
        self, came: Iterable[Received], now: int, *, all_: bool = False
    ) -> list[tuple[int, Received]]:
        """Messages whose time is known by now, each with it [ns], in the order of publication.

        Args:
            came: Messages since the last call, including those of `/clock`.
            now: Time of the system [ns]. A message received long before does not wait any more:
                simulated time is paused.
            all_: Nothing waits; messages before the first `/clock` are dated 0.
        """
        for each in came:
            self._waiting.append(each)
            if each.topic == TOPIC:
                self._tell(each)
        found, self._waiting = self._waiting, []
        if not all_:
            self._waiting = [each for each in found if not self._is_dated(each, now)]
            found = [each for each in found if self._is_dated(each, now)]
        found.sort(key=lambda each: each.published)
        return [(self._at(each.published), each) for each in found]

    def _tell(self, message: Received) -> None:
        at = bisect_right(self._published, message.published)
        self._published.insert(at, message.published)
        told = Time.from_msg(deserialize_message(message.raw, Clock).clock).nanoseconds
        self._told.insert(at, told)
        if len(self._told) > 2 * _KEPT:
            del self._published[:_KEPT], self._told[:_KEPT]

    def _is_dated(self, message: Received, now: int) -> bool:
        if not self.begun:
            return False
        return message.published <= self._published[-1] or now - message.received > PATIENCE

    def _at(self, published: int) -> int:
        if not self.begun:
            return 0
        return self._told[max(bisect_right(self._published, published) - 1, 0)]
