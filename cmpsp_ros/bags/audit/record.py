"""The data of an audit: odometry, commands, parameters and decisions of a recording."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.audit.history import History
from cmpsp_ros.bags.audit.legs import Commands, Leg, Pairs
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.odometry import (
    Hole,
    OdometrySeries,
    holes,
    in_words,
    longest_interval,
    pieces,
)
from cmpsp_ros.bags.runs.run import DrivenPath, Planned, lifetime, plans_in, seen_at
from cmpsp_ros.bags.runs.sensor_clearance import (
    Encounter,
    Knowledge,
    SensorClearance,
    encounters,
    look,
    robot_encounters,
    sightings,
)
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings, to_nanoseconds
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.world.roads import FAR

_NEAR = 3.0  # distance from the robot within which people are judged [m]
_NO_STAMPS = np.empty(0, np.int64)
_stamp, _key = attrgetter('stamp'), attrgetter('key')
EDGES = 2  # the first columns of a clearance are the road's edges


Met = tuple[tuple[Encounter, ...], ...]
"""Encounters in each leg."""


@dataclass(frozen=True)
class Sweep:
    """Arcs with the clearance of the robot itself."""

    settings: GuidanceSettings  # in force
    stamps: IntArray  # beginning of each arc [ns], shape ``(K,)``
    clearance: Array  # distance from both road edges and each obstacle, shape ``(K, 2 + M)`` [m]
    names: tuple[str, ...]  # of its columns, in messages
    by: str = ''  # source of the path, if it is not odometry
    tolerance: float = 0.0  # error of the clearance [m]; less is no proof of a contact

    @classmethod
    def of_seen(cls, history: History, seen: SensorClearance) -> Iterator[Sweep]:
        """Distance from sightings of sensors, which know no road, by the parameters in force."""
        for epoch, at in history.periods(seen.stamps):
            clearance = np.full((len(at), EDGES + 1), FAR)
            np.minimum(seen.clearance[at], FAR, out=clearance[:, EDGES])
            names = (*epoch.settings.road.edge_names, 'what the sensors saw')
            stamps, off = seen.stamps[at], seen.tolerance
            yield cls(epoch.settings, stamps, clearance, names, tolerance=off)


def sweep(
    path: DrivenPath, history: History, by: str = '', tolerance: float = 0.0, off: float = 0.0
) -> Iterator[Sweep]:
    """Arcs of a path by the parameters in force; hidden obstacles count `off` farther away [m]."""
    begins = path.stamps[:-1]
    for epoch, index in history.periods(begins):
        arcs = path.poses[index], path.twists[index], path.durations[index]
        settings = epoch.course
        obstacles = (f'obstacle {each.name}' for each in settings.obstacles)
        names = (*settings.road.edge_names, *obstacles)
        clearance = settings.world.clearance(settings, *arcs)
        clearance[:, EDGES:][:, epoch.of_hidden] += off
        yield Sweep(settings, begins[index], clearance, names, by, tolerance)


@dataclass(frozen=True)
class AuditRecord:
    """The data of an audit: parameters over time, and all messages of a bag by names of topics."""

    path: Path
    places: Names
    history: History
    odometry: OdometrySeries
    commands: Commands
    decisions: tuple[DecisionRecord, ...]  # none in the bag of another program
    others: tuple[str, ...]  # namespaces of the other robots that are to be avoided and are known
    # Data that are lacking or cannot be used, in sentences, by the name of their check.
    unusable: Mapping[str, str]
    pairs: Pairs
    is_ours: bool  # true if the bag has the parameters of a guidance node of this package
    legs: tuple[Leg, ...]  # parts in which time does not jump back and commands were sent

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """Moving obstacles as received, by id and time."""
        return tuple(sorted((e for leg in self.legs for e in leg.tracks), key=_key))

    @cached_property
    def people(self) -> tuple[Track, ...]:
        """People in the simulator as they truly were, by id and time."""
        return tuple(sorted((e for leg in self.legs for e in leg.people), key=_key))

    @cached_property
    def sweeps(self) -> tuple[Sweep, ...]:
        """Path by odometry since each leg's first run, with its clearance from the obstacles known.

        Clearance is infinite inside holes.
        """
        told = (
            replace(leg.history, epochs=tuple(replace(e, hidden=()) for e in leg.history.epochs))
            for leg in self.legs
        )
        swept = zip(self.legs, told, strict=True)
        found = [(leg, each) for leg, known in swept for each in sweep(leg.guided, known)]
        for leg, each in found:
            for hole in leg.by_odometry.holes:
                inside = (each.stamps >= hole.begin) & (each.stamps < hole.end)
                each.clearance[inside] = np.inf
        return tuple(each for _, each in found)

    @cached_property
    def evidence(self) -> tuple[Sweep, ...]:
        """The path by all sources, without holes, and its clearance from all that is known."""
        return tuple(chain.from_iterable(self.evidence_of_legs))

    @cached_property
    def evidence_of_legs(self) -> tuple[tuple[Sweep, ...], ...]:
        """The same of each leg."""
        seen = self.seen or ((),) * len(self.legs)
        return tuple(tuple(_swept(*each)) for each in zip(self.legs, seen, strict=True))

    @cached_property
    def seen(self) -> tuple[tuple[SensorClearance, ...], ...]:
        """Sightings beside the path of each leg, of sensors that saw anything."""
        if not self.settings.sight.sensors:
            return ()
        with Bag(self.path) as bag:
            looked = [self._look(bag, leg) for leg in self.legs]
        return tuple(tuple(each for each in found if len(each.looks)) for found in looked)

    def _look(self, bag: Bag, leg: Leg) -> list[SensorClearance]:
        """Sightings beside the path of a leg, by the outline of the robot at each time."""
        best = next((each.pieces for each in leg.known if each.pieces), ())
        paths = best, leg.by_odometry.pieces
        around = paths, partial(self._moving_at, leg), leg.window
        found, before = list[SensorClearance](), None
        for epoch in leg.history.epochs:
            settings = epoch.settings
            used = settings.footprint, settings.robot_radius, settings.sight
            if used != before:
                later = list(look(bag, self.places.sighting, settings, *around))
                pairs = zip(found or later, later, strict=True)
                found = [_changed(each, since_then, epoch.since) for each, since_then in pairs]
            before = used
        return found

    def knowledge(self) -> Iterator[Callable[[GuidanceSettings, int], GuidanceSettings]]:
        """For each leg: settings with the sightings by a time [ns], for rising times."""
        with Bag(self.path) as bag:
            for leg in self.legs:
                yield Knowledge(sightings(bag, self.places.sighting, leg.window)).of

    @cached_property
    def plans(self) -> tuple[dict[int, Planned], ...]:
        """Recorded plans of each leg, by the stamps of their decisions [ns]."""
        with Bag(self.path) as bag:
            found = [plans_in(bag, self.places.path, leg.window) for leg in self.legs]
        return tuple({each.stamp: each for each in plans} for plans in found)

    @cached_property
    def encounters(self) -> Met:
        """The same path, with the moving obstacles at their predicted positions."""

        def along(leg: Leg, path: DrivenPath, settings: GuidanceSettings) -> Iterator[Encounter]:
            lasts = partial(_lifetime, leg, settings)
            return encounters(path, leg.tracks, settings.bodies, lasts)

        return self._met(along)

    @cached_property
    def people_met(self) -> Met:
        """The same path, with the people near it at their true positions."""

        def along(leg: Leg, path: DrivenPath, settings: GuidanceSettings) -> Iterator[Encounter]:
            stamps = leg.people_stamps
            longest = longest_interval(stamps, self.settings)
            ages = np.diff(np.append(stamps, stamps[-1:] + longest)).clip(max=longest) / NANOSECONDS
            lasts = dict(zip(stamps.tolist(), ages.tolist(), strict=True))
            bodies, near = settings.bodies, _NEAR + settings.circumscribed_radius
            at = np.searchsorted(path.stamps, [each.stamp for each in leg.people], side='right')
            places = path.poses[np.clip(at - 1, 0, len(path.poses) - 1), :2].tolist()
            for each, place in zip(leg.people, places, strict=True):
                if math.dist(place, (each.x, each.y)) < near + each.radius:
                    for met in encounters(path, (each,), bodies, lambda one: lasts[one.stamp]):
                        yield replace(met, name=f'person {each.id}')

        return self._met(along)

    @cached_property
    def robot_encounters(self) -> Met:
        """The same path, with the positions of the other robots at that time."""

        def along(leg: Leg, path: DrivenPath, settings: GuidanceSettings) -> Iterator[Encounter]:
            known = settings.moving_obstacles
            around = known.others_radius, settings.bodies, known.timeout
            for name, other in leg.others.items():
                longest = longest_interval(other.stamps, self.settings)
                for part in pieces(other, int(path.stamps[0]), int(path.stamps[-1]), longest):
                    first, last = (int(part.stamps[k]) for k in (0, -1))
                    yield from robot_encounters(path.between(first, last), {name: part}, *around)

        return self._met(along)

    @cached_property
    def others_sentence(self) -> str:
        """Paths of other robots that are not recorded, in sentences; empty if all are."""
        gaps = []
        for name in self.others:
            found = (leg.others.get(name) for leg in self.legs)
            stamps = [_NO_STAMPS if each is None else each.stamps for each in found]
            gaps.append(self._gap(f'The path of {name} is', stamps))
        return ' '.join(filter(None, (self.unusable['others'], *gaps)))

    @cached_property
    def people_sentence(self) -> str:
        """When people in the simulator are not recorded, in sentences; empty if they always are."""
        gap = self._gap('People are', [leg.people_stamps for leg in self.legs])
        return ' '.join(filter(None, (self.unusable['people'], gap)))

    def _gap(self, subject: str, stamps: Iterable[IntArray]) -> str:
        """Holes from the first run to the end of the last, in a sentence; empty if none.

        `stamps` are the times of what was recorded in each leg [ns].
        """
        found = list[Hole]()
        for leg, known in zip(self.legs, stamps, strict=True):
            longest = longest_interval(known, self.settings)
            found += holes(known, leg.runs[0].start, leg.runs[-1].end, longest)
        return f'{subject} not recorded {in_words(found, self.start)}.' if found else ''

    def _met(
        self, found_along: Callable[[Leg, DrivenPath, GuidanceSettings], Iterable[Encounter]]
    ) -> Met:
        """Encounters along the path by each source, with the parameters in force."""

        def met(leg: Leg) -> Iterator[Encounter]:
            for known in leg.known:
                for path in known.pieces:
                    for epoch, at in leg.history.periods(path.stamps[:-1]):
                        part = path.chosen(np.append(at, at[-1] + 1))
                        for each in found_along(leg, part, epoch.settings):
                            yield replace(each, clearance=each.clearance + known.tolerance)

        return tuple(tuple(met(leg)) for leg in self.legs)

    def _moving_at(self, leg: Leg, stamp: int) -> Array:
        """Discs of all that is known to move at a time [ns], ``(D, 3)`` [m]."""
        settings = leg.history.at(stamp)
        moving = settings.moving_obstacles
        since = stamp - to_nanoseconds(moving.timeout)
        tracks = list[Track]()
        for known in leg.moving:
            first = bisect_left(known, since, key=_stamp)
            last = bisect_right(known, stamp, key=_stamp)
            tracks += seen_at(known[first:last], stamp, settings)
        robots = [
            [*each.at(stamp)[:2].tolist(), moving.others_radius]
            for each in leg.others.values()
            if each.stamps[0] <= stamp <= each.stamps[-1]
        ]
        discs = [[each.x, each.y, each.radius] for each in tracks]
        return np.array(discs + robots).reshape(-1, 3)

    def of_commands(self, value: Callable[[GuidanceSettings], Any]) -> Array:
        """A parameter in force at each command, shape ``(C, ...)``."""
        values = np.array([value(each.settings) for each in self.history.epochs])
        times = [each.received for each in self.history.epochs]
        index = np.searchsorted(times, self.commands.received, side='right') - 1
        return np.asarray(values[np.maximum(index, 0)])

    @property
    def settings(self) -> GuidanceSettings:
        """In force at first."""
        return self.history.epochs[0].settings

    @property
    def start(self) -> int:
        """Time 0 of the first run [ns]."""
        return self.legs[0].runs[0].start

    @property
    def end(self) -> float:
        """Time of the last odometry since then [s]."""
        return self.seconds(int(self.legs[-1].odometry.stamps[-1]))

    def seconds(self, stamp: int) -> float:
        """Time since then [s]."""
        return (stamp - self.start) / NANOSECONDS


def _swept(leg: Leg, seen: Iterable[SensorClearance]) -> Iterator[Sweep]:
    for known in reversed(leg.known):
        for path in known.pieces:
            yield from sweep(path, leg.history, known.by, known.tolerance, known.off)
    for each in seen:
        yield from Sweep.of_seen(leg.history, each)


def _lifetime(leg: Leg, settings: GuidanceSettings, track: Track) -> float:
    """Time for which a track counts [s]; between scans, as long as decisions use it."""
    lasts = lifetime(track, settings)
    if track.is_seen and track.key in leg.last_used:
        used = (leg.last_used[track.key] - track.stamp) / NANOSECONDS
        lasts = max(lasts, used + settings.control_period)
    return lasts


def _changed(before: SensorClearance, after: SensorClearance, since: int) -> SensorClearance:
    """Sightings beside a path whose robot has changed at a time [ns]."""
    clearance = np.where(after.stamps < since, before.clearance, after.clearance)
    looks = before.looks[before.looks < since], after.looks[after.looks >= since]
    return replace(after, clearance=clearance, looks=np.concatenate(looks))


def path_gap(record: AuditRecord, _worst: object = None) -> str:
    """When no source knows the path, in a sentence; empty if one always does."""
    found = [hole for leg in record.legs for hole in leg.holes]
    return f'The path is not recorded {in_words(found, record.start)}.' if found else ''
