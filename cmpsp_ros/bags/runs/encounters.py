"""Distances between a robot and moving obstacles or other robots."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.run import DrivenPath, driven_in
from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots import Bodies
from cmpsp_ros.robots.motion import with_side
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


def read_others(bag: Bag, namespaces: Iterable[str], own: str) -> dict[str, DrivenPath]:
    """Paths of other robots by namespace: the simulator's own if there is one, else odometry."""
    recorded = {name for name, topic in bag.topics.items() if topic.count > 1}
    return {
        each: driven_in(bag, each)
        for each in namespaces
        if each != own and recorded & {f'{each}/sim/truth', f'{each}/odom'}
    }


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
