"""The player: publishes topics of a bag to live nodes, with the time of the recording."""

import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.time import Time
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from cmpsp_ros.bags import Bag, BagError, UnknownTypeError
from cmpsp_ros.nodes.common.runtime import run
from cmpsp_ros.nodes.common.topic import message_class, steady_timer
from cmpsp_ros.nodes.common.topics import CLOCK
from cmpsp_ros.nodes.recording.qos import offering

# Time between two messages of the clock, two looks at the bag, and two at the keyboard [s].
_CLOCK_PERIOD, _PERIOD, _KEY_PERIOD = 0.01, 0.002, 0.05
_BATCH = 1000  # messages published before the services are looked after again
# Topics about nodes that are not there: played only when asked for by name.
_OF_OTHERS = frozenset(('/rosout', '/parameter_events'))


@dataclass(frozen=True)
class Playback:
    """Options of a playback, with times of the recording."""

    rate: float = 1.0
    start_offset: float = 0.0  # [s]
    duration: float | None = None  # [s]
    loop: bool = False
    paused: bool = False  # True if it waits for `~/resume` or the space key
    topics: tuple[str, ...] = ()  # all of them when empty


class _Keyboard:
    """Single keys of the terminal; none without a terminal or in the background."""

    def __init__(self) -> None:
        self._before: list[Any] | None = None
        try:
            is_ours = sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
        except (OSError, ValueError, AttributeError):
            is_ours = False
        if is_ours:
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)

    def pressed(self) -> str:
        """Keys pressed since the last call."""
        keys = ''
        while self._before is not None and select.select([sys.stdin], [], [], 0.0)[0]:
            key = os.read(sys.stdin.fileno(), 1).decode(errors='replace')
            if not key:
                self.close()
            keys += key
        return keys

    def close(self) -> None:
        """Restore the terminal; may be called twice."""
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
            self._before = None


class Player(Node):
    """Publishes messages of an open bag as recorded, with its `/clock` or times of reception."""

    def __init__(self, bag: Bag, topics: Sequence[str], playback: Playback) -> None:
        super().__init__('player')
        self._bag, self._playback = bag, playback
        self._outputs = {
            name: self.create_publisher(
                message_class(bag.topics[name].msgtype),
                name,
                offering(bag.topics[name].qos_profiles),
            )
            for name in topics
        }
        self._clock_output = None if CLOCK.name in topics else CLOCK.publish_on(self)
        self._keyboard, self._count, self._paused = _Keyboard(), 0, playback.paused
        for name, pauses in (
            ('pause', lambda: True),
            ('resume', lambda: False),
            ('toggle_paused', lambda: not self._paused),
        ):
            self.create_service(Trigger, f'~/{name}', partial(self._on_call, pauses))
        self._rewind()
        self._periodic = (
            steady_timer(self, _PERIOD, self._publish_due),
            steady_timer(self, _CLOCK_PERIOD, self._publish_time),
        )
        steady_timer(self, _KEY_PERIOD, self._on_keys)

    def stop(self) -> None:
        """Restore the terminal."""
        self._keyboard.close()
        self.get_logger().info(f'{self._count} messages of {len(self._outputs)} topics played')

    def _rewind(self) -> None:
        begin = self._bag.start + round(self._playback.start_offset * 1e9)
        length = self._playback.duration
        self._end = self._bag.end if length is None else begin + round(length * 1e9)
        self._messages = self._between(begin, self._end)
        self._next = next(self._messages, None)
        self._stamp, self._since = begin, time.monotonic_ns()

    def _between(self, begin: int, end: int) -> Iterator[tuple[str, int, bytes]]:
        for topic, stamp, raw in self._bag.raw_together([*self._outputs]):
            if stamp > end:
                return
            if stamp >= begin:
                yield topic, stamp, raw

    def _now(self) -> int:
        """Bag time [ns]."""
        passed = 0 if self._paused else time.monotonic_ns() - self._since
        return self._stamp + int(passed * self._playback.rate)

    def _pause(self, paused: bool) -> str:
        self._stamp, self._since, self._paused = self._now(), time.monotonic_ns(), paused
        return 'paused' if paused else 'playing'

    def _publish_due(self) -> None:
        now = self._now()
        for _ in range(0 if self._paused else _BATCH):
            if self._next is None or self._next[1] > now:
                break
            topic, stamp, raw = self._next
            self._publish_clock(stamp)
            self._outputs[topic].publish(raw)
            self._count += 1
            self._next = next(self._messages, None)
        if self._paused or self._next is not None or now < self._end:
            return
        if self._playback.loop:
            self._rewind()
            return
        for each in self._periodic:
            each.cancel()
        # Shutting down by a signal delivers the last published messages.
        signal.raise_signal(signal.SIGINT)

    def _publish_time(self) -> None:
        if not self._paused:
            coming = self._end if self._next is None else self._next[1]
            self._publish_clock(min(self._now(), coming))

    def _publish_clock(self, stamp: int) -> None:
        if self._clock_output is not None:
            self._clock_output.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))

    def _on_keys(self) -> None:
        if self._keyboard.pressed().count(' ') % 2:
            self.get_logger().info(self._pause(not self._paused))

    def _on_call(
        self, pauses: Callable[[], bool], _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        response.success, response.message = True, self._pause(pauses())
        return response


def play(path: Path, playback: Playback, remappings: Sequence[str] = ()) -> int:
    """Play a bag until its end or a signal, as the last thing a process does; returns exit code.

    Remappings are rules of ROS, as in `/odom:=/r1/odom`. Raises BagError.
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
    """Topics to play, of types that are installed; by default not `_OF_OTHERS`; or BagError."""
    chosen = []
    for name in list(dict.fromkeys(wanted)) or sorted(bag.topics.keys() - _OF_OTHERS):
        if name not in bag.topics:
            raise bag.lacks(f'no topic {name}')
        try:
            message_class(bag.topics[name].msgtype)
        except UnknownTypeError as error:
            if wanted:
                raise BagError(f'{bag.path}: topic {name}: {error}') from error
            continue
        # A clock that was recorded without a message is no clock.
        if name != CLOCK.name or bag.topics[name].count:
            chosen.append(name)
    return chosen
