"""Recorded commands, and the odometry that each is based on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.odometry import OdometrySeries
from cmpsp_ros.robots import plain, with_side
from cmpsp_ros.sensing import stamp_of

Flags = BoolArray

_TWIST, _STAMPED = 'geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped'

_SAME = 1e-9
"""Difference up to which a command is what a decision says [m/s, rad/s]: it is computed anew."""


@dataclass(frozen=True)
class Commands:
    """Velocity commands in the order in which they were received.

    Attributes:
        received: Time of reception [ns], shape ``(C,)``.
        stamps: Stamp of the odometry that each is based on [ns], ``(C,)``; see `timed`.
        twists: Shape ``(C, 2)`` or ``(C, 3)``; see `Robot`.
        stamped: Whether the messages carried these stamps themselves.
    """

    received: IntArray
    stamps: IntArray
    twists: Array
    stamped: bool

    def chosen(self, index: Flags) -> Commands:
        """Some of the commands."""
        return replace(
            self,
            received=self.received[index],
            stamps=self.stamps[index],
            twists=self.twists[index],
        )

    @property
    def moving(self) -> Flags:
        """Whether each is anything but a stop, shape ``(C,)``."""
        moving: Flags = np.any(self.twists != 0.0, axis=1)
        return moving


@dataclass(frozen=True)
class Pairs:
    """Pairs of commands and decisions.

    Attributes:
        commands: Index of the first command that has a decision.
        decisions: Index of its decision.
        count: Number of consecutive pairs from there on.
    """

    commands: int
    decisions: int
    count: int


def read_commands(bag: Bag, topic: str) -> Commands:
    """Commands of a topic, with the stamps that they carry or else the times of reception.

    Raises:
        BagError: The topic is of another type than Twist and TwistStamped.
    """
    found = bag.topics[topic].msgtype
    if found not in {_TWIST, _STAMPED}:
        raise BagError(
            f'{bag.path}: found {found} in {topic}, wanted {_TWIST} or {_STAMPED} (--cmd-vel)'
        )
    rows = []
    for received, message in bag.messages(topic):
        stamp, twist = received, message
        if found == _STAMPED:
            stamp, twist = stamp_of(message), message.twist
        rows.append((received, stamp, (twist.linear.x, twist.linear.y, twist.angular.z)))
    if not rows:
        raise BagError(f'{bag.path}: found no message in {topic}, wanted commands (--cmd-vel)')
    received_all, stamps, twists = zip(*rows, strict=True)
    return Commands(
        np.array(received_all, dtype=np.int64),
        np.array(stamps, dtype=np.int64),
        plain(np.array(twists, dtype=np.float64)),
        # Who leaves the stamp empty says nothing by it.
        found == _STAMPED and min(stamps) > 0,
    )


def pair(commands: Commands, decided: Array) -> Pairs:
    """Find for each command the decision that it was sent for.

    Both were sent one for one. If there are more of one kind, then the recording missed some of
    the other at its beginning or its end, whichever makes more of them agree.

    Args:
        commands: What was sent.
        decided: What the decisions are, shape ``(D, 2)`` or ``(D, 3)``.
    """
    surplus = len(commands.twists) - len(decided)
    ends = [
        Pairs(max(skipped, 0), max(-skipped, 0), min(len(decided), len(commands.twists)))
        for skipped in (0, surplus)
    ]
    return max(ends, key=lambda each: agreeing(commands, decided, each).sum())


def agreeing(commands: Commands, decided: Array, pairs: Pairs) -> Flags:
    """Whether each command equals that of its decision, shape ``(count,)``."""
    sent = with_side(commands.twists)[pairs.commands :][: pairs.count]
    wanted = with_side(decided)[pairs.decisions :][: pairs.count]
    agree: Flags = np.all(np.abs(sent - wanted) <= _SAME, axis=1)
    return agree


def timed(
    commands: Commands, odometry: OdometrySeries, pairs: Pairs, decisions: Sequence[DecisionRecord]
) -> Commands:
    """Commands with the stamps of the odometry that they are based on.

    A stamped command contains it, a decision contains it for its command, and for any other it is
    the latest odometry received by then.
    """
    if commands.stamped:
        return commands
    latest = np.searchsorted(odometry.received, commands.received, side='right') - 1
    stamps = odometry.stamps[np.maximum(latest, 0)]
    answered = decisions[pairs.decisions :][: pairs.count]
    stamps[pairs.commands :][: pairs.count] = [each.stamp for each in answered]
    return replace(commands, stamps=stamps)
