"""Parameters in force at each moment of a recording."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import Final

import numpy as np

from cmpsp_ros.arrays import IntArray
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag, Window
from cmpsp_ros.bags.replay.recording import EVENTS, NodeParameters, changes_in
from cmpsp_ros.bags.runs.odometry import OdometrySeries
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings
from cmpsp_ros.parameters import TABLE, Values, guidance_settings, load_parameter_file, shapes_of
from cmpsp_ros.world.obstacles import Shape

# Difference from a stamp to the time of odometry from which on it is of another clock [ns].
OTHER_CLOCK: Final = 1_000_000_000
_received = attrgetter('received')


@dataclass(frozen=True)
class Epoch:
    """Period of the same parameters, from `since` [ns]; only the simulator knows `hidden`."""

    received: int  # time of reception [ns]
    since: int
    values: Values
    settings: GuidanceSettings
    hidden: tuple[Shape, ...] = ()

    @cached_property
    def course(self) -> GuidanceSettings:
        """The settings with all obstacles that stand on the course, the hidden ones last."""
        return replace(self.settings, obstacles=self.settings.obstacles + self.hidden)

    @property
    def of_hidden(self) -> slice:
        """Places of the hidden ones among all obstacles."""
        count = len(self.settings.obstacles)
        return slice(count, count + len(self.hidden))


@dataclass(frozen=True)
class History:
    """All parameters over time."""

    # Keys that were recorded; the others are defaults, which are not evidence.
    given: frozenset[str]
    # In order of reception, and of time within a leg; at least one, which began before.
    epochs: tuple[Epoch, ...]
    simulated: bool = False  # true if the robot is simulated, so that all obstacles are known
    has_traffic: bool = False  # true if the simulator moves obstacles
    has_people: bool = False  # true if people walk in it

    def at(self, stamp: int) -> GuidanceSettings:
        """Settings in force at an instant [ns]."""
        return self.epoch_at(stamp).settings

    def periods(self, stamps: IntArray) -> Iterator[tuple[Epoch, IntArray]]:
        """The period of each of ascending stamps [ns]: periods, with the places of theirs."""
        edges = np.searchsorted(stamps, [each.since for each in self.epochs[1:]])
        places = np.split(np.arange(len(stamps)), edges)
        return ((each, at) for each, at in zip(self.epochs, places, strict=True) if len(at))

    def index(self, stamps: IntArray) -> IntArray:
        """The places ``(M,)`` of the periods of instants [ns]."""
        found = np.searchsorted([each.since for each in self.epochs], stamps, side='right') - 1
        return np.maximum(found, 0)

    def epoch_at(self, stamp: int) -> Epoch:
        """The period of an instant [ns]."""
        index = bisect_right(self.epochs, stamp, key=lambda each: each.since) - 1
        return self.epochs[max(index, 0)]

    def received_by(self, received: int) -> Epoch:
        """The period of a time of reception [ns]."""
        index = bisect_right(self.epochs, received, key=_received) - 1
        return self.epochs[max(index, 0)]

    def within(self, window: Window, odometry: OdometrySeries) -> History:
        """The parameters of a leg, from its beginning on, by the clock of its odometry."""
        first, last = (bisect_left(self.epochs, each, key=_received) for each in window)
        since, epochs = 0, list[Epoch]()
        for each in self.epochs[max(first - 1, 0) : last]:
            heard = int(odometry.instants(np.array([each.received]))[0])
            # A restart has no stamp, and a message of the next leg may come before its odometry.
            is_of_clock = abs(each.since - heard) <= OTHER_CLOCK
            since = max(since, each.since if is_of_clock else heard) if epochs else 0
            epochs.append(replace(each, since=since))
        return replace(self, epochs=tuple(epochs))


def read_history(bag: Bag, places: Names, params_file: str | Path | None) -> History:
    """Parameters of guidance node and simulator with their recorded changes, or those of a file."""
    if params_file is not None:
        given = load_parameter_file(params_file, namespace=places.namespace)
        values = TABLE.resolve(given)
        history = History(frozenset(given), (Epoch(0, 0, values, guidance_settings(values)),))
        return _with_course(history, bag, places.sim)
    parameters = NodeParameters(bag, places.node)
    first_command = next((received for received, _ in bag.raw(places.cmd_vel)), bag.end)
    epochs = tuple(
        Epoch(received, since, values, guidance_settings(values))
        for received, since, values in _timeline(bag, parameters, places.node, first_command)
    )
    return _with_course(History(parameters.given, epochs), bag, places.sim)


def _timeline(
    bag: Bag, parameters: NodeParameters, node: str, used_from: float = math.inf
) -> Iterator[tuple[int, int, Values]]:
    """Parameters of a node, with times of reception and from when on they are in force [ns].

    `used_from` then they are needed.
    """
    yield 0, 0, parameters.values
    for received, event in bag.messages(EVENTS) if EVENTS in bag.topics else ():
        if changes := changes_in(event, node):
            yield from _restarts(parameters, received)
            parameters.change(received, changes, used=received >= used_from)
            since = int(event.stamp.sec) * NANOSECONDS + event.stamp.nanosec
            yield received, since, parameters.values
    yield from _restarts(parameters, bag.end)


def _restarts(parameters: NodeParameters, until: int) -> Iterator[tuple[int, int, Values]]:
    while (since := parameters.restart(until)) is not None:
        yield since, since, parameters.values


def _with_course(history: History, bag: Bag, node: str) -> History:
    if node not in bag.parameters:
        return history
    course = [
        (received, since, shapes_of(values))
        for received, since, values in _timeline(bag, NodeParameters(bag, node), node)
    ]
    epochs, starts = [], [received for received, *_ in course]
    changes = {(each.received, each.since) for each in history.epochs}
    for received, since in sorted(changes.union(each[:2] for each in course)):
        epoch = history.received_by(received)
        hidden = course[bisect_right(starts, received) - 1][2]
        epochs.append(replace(epoch, received=received, since=since, hidden=hidden))
    moves, walk = (
        bool(bag.parameters[node].get(f'{each}.names'))
        for each in ('moving_obstacles', 'sim.people')
    )
    known = replace(history, epochs=tuple(epochs), simulated=True)
    return replace(known, has_traffic=moves, has_people=walk)
