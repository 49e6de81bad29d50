"""The player: publishes topics of a bag to live nodes, with the time of the recording."""

from __future__ import annotations

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
from cmpsp_ros.nodes.common.qos import offering
from cmpsp_ros.nodes.common.runtime import run
from cmpsp_ros.nodes.common.topic import message_class, steady_timer
from cmpsp_ros.nodes.common.topics import CLOCK

_CLOCK_PERIOD = 10_000_000
"""Maximum time between two messages of the clock [ns]."""

_MIN_WAIT = 100_000
"""Minimum time between two looks at the bag [ns]."""

_BATCH = 1000
"""Messages published before the services are looked after again."""

_KEY_PERIOD = 0.05

_OF_OTHERS = frozenset(('/rosout', '/parameter_events'))
"""Topics about nodes that are not there: played only when asked for by name."""


@dataclass(frozen=True)
class Playback:
    """Options of a playback: times in seconds of the recording; without topics, all of them.

    When paused, it waits for `~/resume` or the space key.
    """

    rate: float = 1.0
    start_offset: float = 0.0
    duration: float | None = None
    loop: bool = False
    paused: bool = False
    topics: tuple[str, ...] = ()


class PlaybackRate:
    """Bag time [ns] by the time `now` [ns] of a clock that never jumps; paused at first.

    The rate is in seconds of bag time per second.
    """

    def __init__(self, rate: float) -> None:
        self._rate, self._stamp = rate, 0
        self._since: int | None = None

    @property
    def paused(self) -> bool:
        """True while bag time is paused."""
        return self._since is None

    def go_to(self, stamp: int, now: int) -> None:
        """Jump to a bag time [ns]."""
        self._stamp = stamp
        if self._since is not None:
            self._since = now

    def pause(self, now: int) -> None:
        """Pause."""
        self._stamp, self._since = self.stamp(now), None

    def resume(self, now: int) -> None:
        """Resume."""
        self._stamp, self._since = self.stamp(now), now

    def stamp(self, now: int) -> int:
        """Bag time [ns]."""
        since = now if self._since is None else self._since
        return self._stamp + int((now - since) * self._rate)

    def until(self, stamp: int, now: int) -> int:
        """Time to wait for a bag time, if it is not paused [ns]; 0 when it is over."""
        return max(0, int((stamp - self.stamp(now)) / self._rate))


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
    """Publishes serialised messages of an open bag as they were recorded, with `/clock`.

    The clock is the recorded one if there is one; else the time of reception.
    """

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
        self._playback_rate = PlaybackRate(playback.rate)
        self._keyboard, self._count = _Keyboard(), 0
        for name, change in (
            ('pause', self._pause),
            ('resume', self._resume),
            ('toggle_paused', self._toggle),
        ):
            self.create_service(Trigger, f'~/{name}', partial(_answer, change))
        self._timer = steady_timer(self, _MIN_WAIT / 1e9, self._publish_due)
        steady_timer(self, _KEY_PERIOD, self._on_keys)
        self._rewind()
        if not playback.paused:
            self._resume()

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
        self._playback_rate.go_to(begin, time.monotonic_ns())

    def _between(self, begin: int, end: int) -> Iterator[tuple[str, int, bytes]]:
        for topic, stamp, raw in self._bag.raw_together([*self._outputs]):
            if stamp > end:
                return
            if stamp >= begin:
                yield topic, stamp, raw

    def _publish_due(self) -> None:
        """Publish the messages that are due, and schedule the next call."""
        now = time.monotonic_ns()
        if self._playback_rate.paused:
            return
        reached = self._playback_rate.stamp(now)
        for _ in range(_BATCH):
            if self._next is None or self._next[1] > reached:
                break
            topic, stamp, raw = self._next
            self._publish_clock(stamp)
            self._outputs[topic].publish(raw)
            self._count += 1
            self._next = next(self._messages, None)
        if self._next is not None or reached < self._end:
            coming = self._end if self._next is None else self._next[1]
            self._publish_clock(min(reached, coming))
            self._schedule(min(self._playback_rate.until(coming, now), _CLOCK_PERIOD))
        elif self._playback.loop:
            self._rewind()
            self._schedule(0)
        else:
            self._timer.cancel()
            # Shutting down by a signal delivers the last published messages.
            signal.raise_signal(signal.SIGINT)

    def _schedule(self, wait: int) -> None:
        self._timer.timer_period_ns = max(wait, _MIN_WAIT)
        self._timer.reset()

    def _publish_clock(self, stamp: int) -> None:
        if self._clock_output is not None:
            self._clock_output.publish(ClockMessage(clock=Time(nanoseconds=stamp).to_msg()))

    def _on_keys(self) -> None:
        if self._keyboard.pressed().count(' ') % 2:
            self.get_logger().info(self._toggle())

    def _pause(self) -> str:
        self._playback_rate.pause(time.monotonic_ns())
        return 'paused'

    def _resume(self) -> str:
        if self._playback_rate.paused:
            self._playback_rate.resume(time.monotonic_ns())
            self._schedule(0)
        return 'playing'

    def _toggle(self) -> str:
        return self._resume() if self._playback_rate.paused else self._pause()


def _answer(
    change: Callable[[], str], _request: Trigger.Request, response: Trigger.Response
) -> Trigger.Response:
    response.success, response.message = True, change()
    return response


def play(path: Path, playback: Playback, remappings: Sequence[str] = ()) -> int:
    """Play a bag until its end or a signal, as the last thing a process does; returns exit code.

    Remappings are rules of ROS, as in `/odom:=/r1/odom`. Raises BagError for a bag that cannot be
    read, is empty, or lacks a topic.
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
    """Topics of a bag to play, whose types are installed here; by default not `_OF_OTHERS`.

    Raises BagError for one that is not there, or not of a type that is installed here.
    """
    chosen = []
    for name in list(dict.fromkeys(wanted)) or sorted(bag.topics.keys() - _OF_OTHERS):
        if name not in bag.topics:
            there = ', '.join(sorted(bag.topics)) or 'no topic at all'
            raise BagError(f'{bag.path}: no topic {name}; there is {there}')
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
