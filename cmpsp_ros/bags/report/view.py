"""The data of one bag in a report, as arrays over the time since its first run began."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, groupby, pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.audit import AuditRecord, Finding, audit_record
from cmpsp_ros.bags.audit.record import EDGES
from cmpsp_ros.bags.decision_record import DecisionRecord, read_decisions
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.run import DrivenPath, Planned, plans_in
from cmpsp_ros.bags.runs.sensor_clearance import sightings
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings, World
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots import Signal
from cmpsp_ros.view import Part, bodies, body, course, disc, kept_clear, trail
from cmpsp_ros.world.grids import OccupancyGrid
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import FAR

MOST_POINTS = 4000  # points of a curve that are drawn; a screen shows no more
MOST_PLANS = 600  # plans that are kept for the slider
_MOST_GRIDS = 200  # grids that are kept for the slider


@dataclass(frozen=True)
class Band:
    """Consecutive control steps at a fallback level or `arrived`: times [s], first reason."""

    level: str
    begin: float
    end: float
    steps: int
    reason: str


@dataclass(frozen=True)
class View:
    """One bag in a report."""

    label: str
    record: AuditRecord
    # All decisions, those whose command came too late to be sent among them.
    decisions: tuple[DecisionRecord, ...]
    findings: tuple[Finding, ...]
    # Some of the plans, in order of time; none if they were not recorded.
    plans: tuple[Planned, ...]
    # Some of the grids that sensors had shown, with their times [ns].
    grids: tuple[tuple[int, OccupancyGrid], ...]
    version: str  # of this package that recorded it, or empty

    @property
    def settings(self) -> GuidanceSettings:
        """Settings in force at the beginning."""
        return self.record.history.at(self.record.start)

    @property
    def shapes(self) -> tuple[Shape, ...]:
        """All static obstacles that guidance knew."""
        epochs = self.record.history.epochs
        return tuple(dict.fromkeys(shape for each in epochs for shape in each.settings.obstacles))

    @property
    def hidden(self) -> tuple[Shape, ...]:
        """Obstacles that only the simulator knew at first; none without our simulator."""
        return self.record.history.epochs[0].hidden

    @cached_property
    def people(self) -> tuple[tuple[Track, ...], ...]:
        """True positions of each of the simulator's people, in order of time."""
        return _by_id(self.record.people)

    @cached_property
    def course(self) -> tuple[Part, ...]:
        """Each road that was driven on, and all static obstacles."""
        epochs = self.record.history.epochs
        later = (each.settings.road for each in epochs if each.since > self.record.start)
        roads = dict.fromkeys((self.settings.road, *later))
        return course(roads, self.shapes, self.hidden)

    @cached_property
    def run(self) -> tuple[Part, ...]:
        """Margins, all that moves, other robots, and last the robot itself at both ends."""
        return (
            kept_clear(self.settings, self.settings.world),
            *(
                Part('moving', (_places(each),), ((each[0].name, (each[0].x, each[0].y)),))
                for each in self.tracks
                if not each[0].is_seen
            ),
            Part('tracked', tuple(_places(each) for each in self.tracks if each[0].is_seen)),
            *(self._person(each) for each in self.people),
            *(self._other(name, each) for name, each in self.others),
            trail(self.settings, self.poses),
            bodies(body(self.settings), self.poses[[0, -1]]),
        )

    @cached_property
    def tracks(self) -> tuple[tuple[Track, ...], ...]:
        """Received positions of each moving obstacle, in order of time."""
        return _by_id(self.record.tracks)

    @cached_property
    def others(self) -> tuple[tuple[str, DrivenPath], ...]:
        """Namespaces of the other robots, and their paths since the beginning, thinned."""
        found = []
        for name, each in (pair for leg in self.record.legs for pair in leg.others.items()):
            chosen = thinned(np.flatnonzero(each.stamps >= self.record.start), MOST_POINTS)
            if len(chosen):
                found.append((name, each.chosen(chosen)))
        return tuple(found)

    @property
    def end(self) -> float:
        """When the recording ends [s]."""
        return self.record.end

    @cached_property
    def _chosen(self) -> NDArray[np.intp]:
        odometry = self.record.odometry
        return thinned(np.flatnonzero(odometry.stamps >= self.record.start), MOST_POINTS)

    @cached_property
    def times(self) -> Array:
        """When each pose was measured [s], shape ``(K,)``."""
        return self._seconds(self.record.odometry.stamps[self._chosen])

    @cached_property
    def poses(self) -> Array:
        """Poses measured, headings without jumps, shape ``(K, 3)`` [m, m, rad]."""
        poses = self.record.odometry.poses[self._chosen].copy()
        poses[:, 2] = np.unwrap(poses[:, 2])
        return poses

    @cached_property
    def commands(self) -> tuple[Array, list[Signal]]:
        """Times of the commands [s], and their signals."""
        commands = self.record.commands
        chosen = thinned(np.arange(len(commands.stamps)), MOST_POINTS)
        signals = self.settings.robot.signals(commands.twists[chosen])
        return self._seconds(commands.stamps[chosen]), signals

    @cached_property
    def driven(self) -> tuple[Array, list[Signal]]:
        """When each arc begins [s], and the controls that drive it."""
        paths = [leg.guided for leg in self.record.legs]
        times = np.concatenate([self._seconds(each.stamps[:-1]) for each in paths])
        twists = np.concatenate([each.twists[:-1] for each in paths])
        chosen = thinned(np.arange(len(times)), MOST_POINTS)
        return times[chosen], self.settings.robot.signals(twists[chosen])

    @cached_property
    def clearance(self) -> tuple[Array, dict[str, Array]]:
        """Time [s], and clearance from all things by their kind [m], each ``(K,)``."""
        sweeps = self.record.sweeps
        times = np.concatenate([self._seconds(each.stamps) for each in sweeps])
        road = np.concatenate([each.clearance[:, :EDGES].min(axis=1) for each in sweeps])
        # On open floor there are no edges, and nothing is to be shown.
        road[road >= FAR] = np.inf
        obstacles = np.concatenate(
            [each.clearance[:, EDGES:].min(axis=1, initial=np.inf) for each in sweeps]
        )
        robots = np.full(len(times), np.inf)
        for values, found in (
            (obstacles, self.record.encounters),
            (robots, self.record.robot_encounters),
        ):
            for each in chain.from_iterable(found):
                index = np.searchsorted(times, self._seconds(each.stamps), side='right') - 1
                np.minimum.at(values, np.maximum(index, 0), each.clearance)
        settings, there = self.settings, World(self.settings.road, self.hidden)
        paths = (leg.guided for leg in self.record.legs)
        arcs = ((each.poses[:-1], each.twists[:-1], each.durations) for each in paths)
        away = (there.clearance(settings, *each)[:, EDGES:] for each in arcs)
        hidden = [each.min(axis=1, initial=np.inf) for each in away]
        named = {
            'road edges': road,
            'obstacles': obstacles,
            'obstacles that only the simulator knows': np.concatenate(hidden),
            'other robots': robots,
        }
        finite = {name: values for name, values in named.items() if np.isfinite(values).any()}
        begins = np.arange(0, len(times), -(-len(times) // MOST_POINTS))
        least = {name: np.minimum.reduceat(each, begins) for name, each in finite.items()}
        return times[begins], least

    @cached_property
    def steps(self) -> tuple[Array, Array]:
        """Time of each control step that was timed [s], and how long it took [ms]."""
        timed = [each for each in self.decisions if each.step_ms is not None]
        stamps = np.array([each.stamp for each in timed], dtype=np.int64)
        return self._seconds(stamps), np.array([each.step_ms or 0.0 for each in timed])

    @cached_property
    def missed_deadlines(self) -> tuple[Array, Array]:
        """Time of each control step that missed its deadline [s], and its response time [ms]."""
        settings = [self.record.history.at(each.stamp) for each in self.decisions]
        found = [
            (each.stamp, each.response_ms(its.command_delay))
            for each, its in zip(self.decisions, settings, strict=True)
            if each.misses_deadline(its.control_period, its.command_delay)
        ]
        stamps = np.array([stamp for stamp, _ in found], dtype=np.int64)
        return self._seconds(stamps), np.array([response for _, response in found])

    @cached_property
    def bands(self) -> tuple[Band, ...]:
        """The fallback levels over time."""
        decisions = self.record.decisions
        kinds = [_kind(each) for each in decisions]
        begins = [k for k, kind in enumerate(kinds) if not k or kind != kinds[k - 1]]
        times = [self.record.seconds(each.stamp) for each in decisions]
        times.append(max([self.end, *times]))
        return tuple(
            Band(_shown(decisions[k]), times[k], times[end], end - k, decisions[k].reason)
            for k, end in pairwise([*begins, len(decisions)])
        )

    def _person(self, tracks: Sequence[Track]) -> Part:
        """Path of a person, and the body where it was nearest to the robot, with the time."""
        times = self._seconds(np.array([each.stamp for each in tracks], dtype=np.int64))
        robot = [np.interp(times, self.times, each) for each in self.poses[:, :2].T]
        index = int(np.hypot(*(_places(tracks).T - robot)).argmin())
        center = tracks[index].x, tracks[index].y
        name = f'{times[index]:.1f} s', center
        return Part('person', (_places(tracks),), (name,), ((center, tracks[index].radius),))

    def _other(self, name: str, driven: DrivenPath) -> Part:
        ends = bodies(disc(self.settings.moving_obstacles.others_radius), driven.poses[[0, -1]])
        x, y, _ = driven.poses[len(driven.poses) // 4].tolist()
        return Part('robot', (driven.poses[:, :2], *ends.lines), ((name, (x, y)),))

    def _seconds(self, stamps: IntArray) -> Array:
        return np.asarray((stamps - self.record.start) / NANOSECONDS)


def view(path: Path, label: str, record: AuditRecord) -> View:
    """Everything that is shown of a bag."""
    with Bag(path) as bag:
        found, version = plans_in(bag, record.places.path), bag.version
        decisions = read_decisions(bag, record.places.decision)
        seen = bag.topics.get(record.places.sighting)
        chosen = set(thinned(np.arange(0 if seen is None else seen.count), _MOST_GRIDS).tolist())
        shown = enumerate(sightings(bag, record.places.sighting, (0.0, np.inf)))
        grids = tuple(each for number, each in shown if number in chosen)
    plans = tuple(found[each] for each in thinned(np.arange(len(found)), MOST_PLANS))
    findings = audit_record(record)
    return View(label, record, decisions, findings, plans, grids, version)


def thinned(index: NDArray[np.intp], most: int) -> NDArray[np.intp]:
    """Some of many indices, evenly, the first and the last among them."""
    if len(index) <= most:
        return index
    return index[np.linspace(0, len(index) - 1, most).round().astype(np.intp)]


def labels(paths: Sequence[Path]) -> list[str]:
    """Short names that distinguish the bags; a link has the name of its target."""
    short = [
        each.parent.name if each.name == 'bag' and each.parent.name else each.name
        for each in (path.resolve() for path in paths)
    ]
    if len(set(short)) == len(short):
        return short
    return [f'{name} ({number})' for number, name in enumerate(short, 1)]


def _by_id(tracks: Sequence[Track]) -> tuple[tuple[Track, ...], ...]:
    return tuple(tuple(each) for _, each in groupby(tracks, key=lambda each: each.id))


def _places(tracks: Sequence[Track]) -> Array:
    return np.array([(each.x, each.y) for each in tracks])


def _shown(decision: DecisionRecord) -> str:
    return 'arrived' if decision.arrived else decision.level


def _kind(decision: DecisionRecord) -> tuple[str, str]:
    """Level and sentence, without the figures in it."""
    return _shown(decision), re.sub(r'[-+]?\d[\d.e+-]*', '#', decision.reason)
