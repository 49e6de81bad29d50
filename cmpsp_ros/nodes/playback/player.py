"""The player: publishes topics of a bag to live nodes, with the time of the recording."""

from __future__ import annotations

import signal
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from cmpsp_ros.bags import Bag, BagError, UnknownTypeError
from cmpsp_ros.nodes.common.message_types import message_class
from cmpsp_ros.nodes.common.qos import offering
from cmpsp_ros.nodes.common.runtime import run
from cmpsp_ros.nodes.common.topics import CLOCK
from cmpsp_ros.nodes.playback.keyboard import Keyboard
from cmpsp_ros.nodes.playback.playback_rate import PlaybackRate

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from pathlib import Path

_CLOCK_PERIOD = 10_000_000
"""Longest time for which the clock is not heard of [ns]."""

_SHORTEST_WAIT = 100_000
"""Between two looks at the bag [ns]."""

_BATCH = 1000
"""Messages published before the services are looked after again."""

_KEY_PERIOD = 0.05

_OF_OTHERS = frozenset(('/rosout', '/parameter_events'))
"""What tells of nodes that are not there: played only when asked for by name."""


@dataclass(frozen=True)
class Playback:
    """How a bag is played.

    Attributes:
        rate: Seconds of the recording per second.
        start_offset: Where to begin, from the first message [s].
        duration: Length to play of the recording [s]; None for all.
        loop: Whether to repeat it.
        paused: Whether to wait for `~/resume` or the space key.
        topics: Topics to play, by recorded name; all when empty.
    """

    rate: float = 1.0
    start_offset: float = 0.0
    duration: float | None = None
    loop: bool = False
    paused: bool = False
    topics: tuple[str, ...] = ()


class Player(Node):
    """Publishes serialised messages as they were recorded, with `/clock`.

    The clock is the recorded one if there is one; else the time of reception.
    """

    def __init__(self, bag: Bag, topics: Sequence[str], playback: Playback) -> None:
        """Create the publishers, and begin unless paused.

        Args:
            bag: An open bag.
            topics: What to play.
            playback: How.
        """
        super().__init__('player')
        self._bag, self._playback, self._topics_played = bag, playback, topics
        self._outputs = {
            name: self.create_publisher(
                message_class(bag.topics[name].msgtype),
                name,
                offering(bag.topics[name].qos_profiles),
            )
            for name in topics
        }
        self._clock_output = None if CLOCK.name in topics else CLOCK.publish_on(self)
        self._playback_rate = PlaybackRate(playback.rate)
        self._keyboard, self._count = Keyboard(), 0
        for name, answer in (
            ('pause', self._pause),
            ('resume', self._resume),
            ('toggle_paused', self._toggle),
        ):
            self.create_service(Trigger, f'~/{name}', self._service(answer))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(_SHORTEST_WAIT / 1e9, self._go_on, clock=steady)
        self.create_timer(_KEY_PERIOD, self._listen, clock=steady)
        self._rewind()
        if playback.paused:
            self._pause()
        else:
            self._resume()

    def stop(self) -> None:
        """Give the terminal back."""
        self._keyboard.close()
        self.get_logger().info(f'{self._count} messages of {len(self._outputs)} topics played')

    def _rewind(self) -> None:
        self._begin = self._bag.start + round(self._playback.start_offset * 1e9)
        length = self._playback.duration
        self._end = self._bag.end if length is None else self._begin + round(length * 1e9)
        self._messages = self._chosen()
        self._next = next(self._messages, None)
        self._playback_rate.go_to(self._begin, time.monotonic_ns())

    def _chosen(self) -> Iterator[tuple[str, int, bytes]]:
        for topic, stamp, raw in self._bag.raw_together(self._topics_played):
            if stamp > self._end:
                return
            if stamp >= self._begin:
                yield topic, stamp, raw

    def _go_on(self) -> None:
        """Publish the messages that are due, and schedule the next call."""
        now = time.monotonic_ns()
        if self._playback_rate.paused:
            return
        reached = self._playback_rate.stamp(now)
        for _ in range(_BATCH):
            if self._next is None or self._next[1] > reached:
                break
            topic, stamp, raw = self._next
            self._tell_time(stamp)
            self._outputs[topic].publish(raw)
            self._count += 1
            self._next = next(self._messages, None)
        if self._next is None and reached >= self._end:
            self._finish()
            return
        coming = self._end if self._next is None else self._next[1]
        self._tell_time(min(reached, coming))
        self._look_again(min(self._playback_rate.until(coming, now), _CLOCK_PERIOD))

    def _look_again(self, wait: int) -> None:
        self._timer.timer_period_ns = max(wait, _SHORTEST_WAIT)
        self._timer.reset()

    def _tell_time(self, stamp: int) -> None:
        if self._clock_output is not None:
            self._clock_output.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))

    def _finish(self) -> None:
        if self._playback.loop:
            self._rewind()
            self._look_again(0)
            return
        self._timer.cancel()
        # The way out that delivers what was published last.
        signal.raise_signal(signal.SIGINT)

    def _listen(self) -> None:
        if self._keyboard.pressed().count(' ') % 2:
            self.get_logger().info(self._toggle())

    def _pause(self) -> str:
        self._playback_rate.pause(time.monotonic_ns())
        return 'paused'

    def _resume(self) -> str:
        if self._playback_rate.paused:
            self._playback_rate.resume(time.monotonic_ns())
            self._look_again(0)
        return 'playing'

    def _toggle(self) -> str:
        return self._resume() if self._playback_rate.paused else self._pause()

    @staticmethod
    def _service(
        change: Callable[[], str],
    ) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
        def answer(_request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
            response.success, response.message = True, change()
            return response

        return answer


def play(path: Path, playback: Playback, remappings: Sequence[str] = ()) -> int:
    """Play a bag until its end or a signal, as the last thing a process does.

    Args:
        path: The bag.
        playback: How.
        remappings: Rules of ROS, as in `/odom:=/r1/odom`.

    Returns:
        Exit code of the process.

    Raises:
        BagError: The bag cannot be read, is empty, or lacks a topic.

    """
    with Bag(path) as bag:
        topics = chosen_topics(bag, playback.topics)
        if not sum(bag.topics[name].count for name in topics):
            raise BagError(f'{path}: no message to play in {", ".join(topics) or "any topic"}')
        rules = [part for rule in remappings for part in ('-r', rule)]
        return run(
            lambda: Player(bag, topics, playback), name='player', args=['--ros-args', *rules]
        )


def chosen_topics(bag: Bag, wanted: Sequence[str]) -> list[str]:
    """Which topics of a bag to play.

    Args:
        bag: An open bag.
        wanted: By name; empty for all but those of other nodes' own affairs.

    Returns:
        Those whose type is installed here.

    Raises:
        BagError: One that is wanted is not there, or not of a type that is installed here.

    """
    names = list(dict.fromkeys(wanted)) or sorted(bag.topics.keys() - _OF_OTHERS)
    chosen = []
    for name in names:
        if name not in bag.topics:
            there = ', '.join(sorted(bag.topics)) or 'no topic at all'
            raise BagError(f'{bag.path}: no topic {name}; there is {there}')
        try:
            message_class(bag.topics[name].msgtype)
        except UnknownTypeError as error:
            if wanted:
                raise BagError(f'{bag.path}: topic {name}: {error}') from error
            continue
        chosen.append(name)
    # A clock that was recorded without a message is no clock.
    return [name for name in chosen if name != CLOCK.name or bag.topics[name].count]
