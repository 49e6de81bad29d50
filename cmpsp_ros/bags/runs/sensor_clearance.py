"""Clearance from moving obstacles, robots and sightings, before the robot came there and after."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.bags.reader import Bag, Window
from cmpsp_ros.bags.runs.odometry import Hole, holes, longest_interval
from cmpsp_ros.bags.runs.run import DrivenPath
from cmpsp_ros.guidance import NANOSECONDS, SEEN, GuidanceSettings, to_nanoseconds
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots import Bodies, Footprint, contains, placed
from cmpsp_ros.robots.motion import with_side
from cmpsp_ros.sensing import (
    Beams,
    LocalGrid,
    ScanError,
    Sensor,
    Sight,
    grid_of,
    projected,
    sight_of,
    stamp_of,
)
from cmpsp_ros.world.grids import Cell, GridError, GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import MovingDiscs

_STANDS = 0.051  # speed of any point of a robot up to which it counts as standing [m/s]
_DIGITS = 9  # digits of a depth behind the point [m]; those behind are rounding errors


@dataclass(frozen=True)
class Encounter:
    """Part of a path, with its distance from one moving obstacle or other robot."""

    name: str  # in messages
    stamps: IntArray  # beginning of each arc [ns], shape ``(K,)``
    clearance: Array  # distance from it, less the robot's radius, shape ``(K,)`` [m]
    # True if the robot stood or crept, shape ``(K,)``: a collision is then not its own.
    stands: BoolArray


def encounters(
    path: DrivenPath, tracks: Sequence[Track], bodies: Bodies, lifetime_of: Callable[[Track], float]
) -> Iterator[Encounter]:
    """Every part of a path with the moving obstacles of that time, at constant velocity.

    An obstacle is dropped after its lifetime [s]; `bodies` as in `GuidanceSettings.bodies`.
    """
    begin, end = int(path.stamps[0]), int(path.stamps[-1])
    for index, each in enumerate(tracks):
        until = each.stamp + round(lifetime_of(each) * NANOSECONDS)
        if index + 1 < len(tracks) and tracks[index + 1].id == each.id:
            until = min(until, tracks[index + 1].stamp)
        first, last = max(each.stamp, begin), min(until, end)
        if first >= last:
            continue
        part = path.between(first, last)
        arcs = part.poses[:-1], part.twists[:-1], part.durations
        since = (part.stamps[:-1] - each.stamp) / NANOSECONDS
        least = []
        for points, radius in bodies:
            state = each.x, each.y, each.vx, each.vy, each.radius + radius, 0.0, 0.0
            disc = MovingDiscs((each.name,), np.array([state]), np.zeros(1, np.int64))
            least.append(disc.along(*arcs, since, points)[:, 0])
        speeds = np.hypot(*with_side(part.twists[:-1]).T[:2])
        reach = max(float(np.hypot(*points.T).max()) for points, _ in bodies)
        stands = speeds + reach * np.abs(part.twists[:-1, -1]) <= _STANDS
        yield Encounter(each.name, part.stamps[:-1], np.max(least, axis=0), stands)


def driven_into(met: Iterable[Encounter]) -> Iterator[tuple[Encounter, Array]]:
    """Encounters in order of time, each with its clearance while the robot drives, ``(K,)`` [m].

    It is infinite at rest. One that was run into at rest may leave: it counts how much deeper
    it gets.
    """
    depths: dict[str, float] = {}
    for each in sorted(met, key=lambda each: int(each.stamps[0])):
        depth, kept = depths.get(each.name, 0.0), np.full(len(each.clearance), math.inf)
        for k, (clear, stands) in enumerate(zip(each.clearance.tolist(), each.stands, strict=True)):
            depth = 0.0 if clear >= 0.0 else min(depth, clear) if stands else depth
            kept[k] = math.inf if stands else round(clear - depth, _DIGITS) + 0.0
        depths[each.name] = depth
        yield each, kept


def robot_encounters(
    path: DrivenPath,
    others: Mapping[str, DrivenPath],
    radius: float,
    bodies: Bodies,
    timeout: float,
) -> Iterator[Encounter]:
    """Parts of a path with other robots of a radius [m], extrapolated for `timeout` [s]."""
    grown = [(points, own + radius) for points, own in bodies]
    for namespace, other in others.items():
        for each in encounters(path, _tracks(other), grown, lambda _: timeout):
            yield replace(each, name=f'robot {namespace}')


def _tracks(driven: DrivenPath) -> list[Track]:
    velocities = np.diff(driven.poses[:, :2], axis=0) / driven.durations[:, None]
    rows = zip(
        driven.stamps.tolist(),
        driven.poses[:, :2].tolist(),
        [*velocities.tolist(), [0.0, 0.0]],
        strict=True,
    )
    return [Track(0, stamp, 0.0, x, y, vx, vy) for stamp, (x, y), (vx, vy) in rows]


EXACT: Final = 0.05  # error of ranges, odometry and cells together [m]
_GRID: Final = 'nav_msgs/msg/OccupancyGrid'

_RESTS: Final = 0.01  # largest motion of a robot at rest [m, rad]
_AROUND: Final = 20.0  # side of the square around the robot in which spots are kept, at most [m]
_BLOCK: Final = 600  # scans that are held at once, to be looked at in both directions of time


@dataclass(frozen=True, eq=False)
class SensorClearance:
    """Distance of a robot from the sightings of its sensors."""

    stamps: IntArray  # times of poses, in order, shape ``(K,)`` [ns]
    poses: Array  # shape ``(K, 3)`` [m, m, rad]
    # Distance of the robot's outline at each from the nearest spot that a beam met and no later
    # beam (before: no earlier one) passed, negative inside, shape ``(K,)`` [m].
    clearance: Array
    looks: IntArray  # times of the messages that showed anything, in order, shape ``(L,)`` [ns]
    tolerance: float  # error of the clearance [m]
    # Times of usable messages by the name of their sensor, in order [ns]; empty for `~/sighting`.
    heard: Mapping[str, IntArray] = field(default_factory=dict)

    def blind(self, looks: IntArray, settings: GuidanceSettings) -> tuple[Hole, ...]:
        """Times of driving with nothing seen for `sight.timeout`; `looks`: all sightings [ns]."""
        longest = longest_interval(looks, settings)
        longest = max(longest, to_nanoseconds(settings.sight.timeout))
        found = holes(looks, int(self.stamps[0]), int(self.stamps[-1]), longest)
        return tuple(each for each in found if self._drives(each))

    def _drives(self, hole: Hole) -> bool:
        inside = (self.stamps >= hole.begin) & (self.stamps <= hole.end)
        return bool(len(self.poses[inside]) and np.ptp(self.poses[inside], axis=0).max() > _RESTS)


class Knowledge:
    """Grid that sensors had shown by a time, as `~/sighting` has it."""

    def __init__(self, grids: Iterator[tuple[int, OccupancyGrid]]) -> None:
        self._grids, self._next = grids, next(grids, None)
        self._seen: OccupancyGrid | None = None

    def of(self, settings: GuidanceSettings, stamp: int) -> GuidanceSettings:
        """Settings with the obstacles seen by a time [ns], not before that of the last call."""
        while self._next is not None and self._next[0] <= stamp:
            self._seen, self._next = self._next[1], next(self._grids, None)
        if self._seen is None:
            return settings
        seen = GridObstacle(SEEN, self._seen, unknown_is_free=True)
        return replace(settings, obstacles=(*settings.obstacles, seen))


def sightings(bag: Bag, topic: str, window: Window) -> Iterator[tuple[int, OccupancyGrid]]:
    """Stamp [ns] and grid of each `~/sighting` that was received in a time [ns]."""
    if topic in bag.topics and bag.topics[topic].msgtype == _GRID:
        for _, message in bag.messages(topic, window):
            with suppress(GridError):
                yield stamp_of(message), grid_of(message, message.header.frame_id)


def look(
    bag: Bag,
    topic: str,
    settings: GuidanceSettings,
    paths: tuple[Sequence[DrivenPath], Sequence[DrivenPath]],
    moving: Callable[[int], Array],
    window: Window,
) -> Iterator[SensorClearance]:
    """Obstacles beside a path in scans, clouds and `~/sighting`, the full name `topic`.

    `paths` are parts without holes of the best path known, and of that by odometry, in whose
    frame the grid is. `moving` are discs ``(x, y, radius)`` of all that moves at a time [ns],
    ``(D, 3)``; `window` are receptions from the first message that counts to the first that
    does not [ns].
    """
    best, heard = paths
    if best:
        judge, looks = _ClearanceTracker(settings, best), list[int]()
        spots, last = np.empty((0, 2)), judge.begin
        heard_of: dict[str, list[int]] = {each.name: [] for each in settings.sight.sensors}
        scans = _scans(bag, topic, settings, best, window, heard_of)
        while block := list(islice(scans, _BLOCK)):
            # Beams that end at moving obstacles have hit nothing static.
            block = [
                replace(each, hits=each.hits & ~_in_discs(each.ends, moving(each.stamp)))
                for each in sorted(block, key=lambda each: each.stamp)
            ]
            looks += [each.stamp for each in block if each.hits.any()]
            spots, last = judge.look(block, 1)
            # A cloud never shows that something has gone, nor that it came.
            sweeps = [replace(each, stamp=-each.stamp) for each in block if each.is_sweep]
            judge.look(sweeps[::-1], -1)
        # No beam passes them after the last scan.
        judge.near(spots, last, min(judge.end, last + to_nanoseconds(settings.sight.memory)))
        times = {name: np.unique(np.array(each, np.int64)) for name, each in heard_of.items()}
        yield replace(judge.seen(looks, EXACT), heard=times)
    if heard:
        judge, looks, tolerance = _ClearanceTracker(settings, heard), [], EXACT
        before, end, spots = judge.begin, judge.end, np.empty((0, 2))
        for stamp, grid in sightings(bag, topic, window):
            if before <= stamp <= end:
                judge.near(spots, before, stamp)
                spots = grid.centers(*np.nonzero(grid.cells == Cell.OCCUPIED))
                spots = spots[~_in_discs(spots, moving(stamp))]
                judge.near(spots, before, stamp)
                before, tolerance = stamp, max(tolerance, 0.75 * grid.resolution)
                looks += [stamp] if len(spots) else []
        judge.near(spots, before, end)
        yield judge.seen(looks, tolerance)


class _ClearanceTracker:
    """Takes in spots that are occupied for a time, and keeps the least distance at each pose."""

    def __init__(self, settings: GuidanceSettings, paths: Sequence[DrivenPath]) -> None:
        self._settings = settings
        self._stamps = np.concatenate([each.stamps for each in paths])
        self._poses = np.concatenate([each.poses for each in paths])
        self._clearance = np.full(len(self._stamps), math.inf)
        self.begin, self.end = int(self._stamps[0]), int(self._stamps[-1])

    def seen(self, looks: Sequence[int], tolerance: float) -> SensorClearance:
        """The distances, and when anything was seen."""
        when = np.unique(np.array(looks, np.int64))
        return SensorClearance(self._stamps, self._poses, self._clearance, when, tolerance)

    def look(self, scans: Iterable[Beams], direction: int) -> tuple[Array, int]:
        """Go through scans in order of time, or backwards with negative stamps.

        Returns the spots ``(P, 2)`` [m] that are occupied after the last, and its time [ns].
        """
        sight = self._settings.sight
        grid = LocalGrid(min(sight.size, _AROUND), sight.resolution, sight.memory)
        spots, before = np.empty((0, 2)), 0
        for each in scans:
            stamp = direction * each.stamp
            self.near(spots, *sorted((before, stamp)))
            pose = self._poses[np.searchsorted(self._stamps, stamp).clip(max=len(self._poses) - 1)]
            grid.center_on(float(pose[0]), float(pose[1]))
            # The robot sees parts of itself, and objects that it touches: other checks cover these.
            of_itself = each.hits & (self._away(each.ends, pose[None])[0] < 0.0)
            ends = np.where(of_itself[:, None], each.starts, each.ends)
            grid.see(replace(each, ends=ends, hits=each.hits & ~of_itself))
            spots, before = grid.hits(each.stamp), stamp
        return spots, before

    def near(self, spots: Array, begin: int, end: int) -> None:
        """Measure the distance from spots at all poses between two times [ns]."""
        first, last = np.searchsorted(self._stamps, [begin, end + 1])
        poses = self._poses[first:last]
        if not len(poses) or not len(spots):
            return
        middle = poses[:, :2].mean(axis=0)
        reach = 1.0 + 2.0 * self._settings.circumscribed_radius
        reach += float(np.hypot(*(poses[:, :2] - middle).T).max())
        spots = spots[np.hypot(*(spots - middle).T) < reach]
        if len(spots):
            least = self._away(spots, poses).min(axis=1)
            np.minimum(self._clearance[first:last], least, out=self._clearance[first:last])

    def _away(self, points: Array, poses: Array) -> Array:
        """Distance of points ``(P, 2)`` from the outline at poses ``(S, 3)``, ``(S, P)`` [m]."""
        footprint = self._settings.footprint
        if footprint.corners:
            return np.array([_from_polygon(footprint, points, pose) for pose in poses])
        to = points - poses[:, None, :2]
        return np.asarray(np.hypot(to[..., 0], to[..., 1]) - self._settings.robot_radius)


def _from_polygon(footprint: Footprint, points: Array, pose: Array) -> Array:
    """Distance of points ``(P, 2)`` from a footprint, negative inside, ``(P,)`` [m]."""
    corners = placed(np.array(footprint.corners), pose)
    sides, to = np.roll(corners, -1, axis=0) - corners, points[:, None] - corners
    part = np.clip((to * sides).sum(axis=2) / np.square(sides).sum(axis=1), 0.0, 1.0)
    off = to - part[..., None] * sides
    least = np.hypot(off[..., 0], off[..., 1]).min(axis=1)
    return np.asarray(np.where(contains(corners, points), -least, least))


def _scans(
    bag: Bag,
    topic: str,
    settings: GuidanceSettings,
    paths: Sequence[DrivenPath],
    window: Window,
    heard: Mapping[str, list[int]],
) -> Iterator[Beams]:
    """All scans that were made while the path is known, as it says where the sensors were."""
    namespace = topic.rpartition('/')[0].rpartition('/')[0]
    sensors: dict[str, list[Sensor]] = {}
    for each in settings.sight.sensors:
        name = each.topic_in(namespace)
        if name in bag.topics and bag.topics[name].msgtype == each.message_type:
            sensors.setdefault(name, []).append(each)
    for name, _, message in bag.together(list(sensors), window) if sensors else ():
        for sensor in sensors[name]:
            # The node refuses it too.
            with suppress(ScanError):
                sight = sight_of(message, sensor)
                heard[sensor.name].append(sight.stamp)
                yield from _beams(sight, paths)


def _beams(sight: Sight, paths: Sequence[DrivenPath]) -> Iterator[Beams]:
    first = int(sight.stamps[0]) if len(sight.stamps) else sight.stamp
    for each in paths:
        if each.stamps[0] <= first and sight.stamp <= each.stamps[-1]:
            yield projected(sight, each.at_all(sight.stamps))
            return


def _in_discs(points: Array, discs: Array) -> BoolArray:
    away = np.hypot(*(points[:, None] - discs[:, :2]).transpose(2, 0, 1))
    return np.asarray((away <= discs[:, 2] + EXACT).any(axis=1))
