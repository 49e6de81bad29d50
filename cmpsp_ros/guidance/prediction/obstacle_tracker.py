"""Moving obstacles of a control step, all that they may reach, and people who have stopped."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.messages.tracks import MovingObject, PeerTrajectory, Track
from cmpsp_ros.guidance.solver_settings import MovingObstacles
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.grids import Cell, Cells
from cmpsp_ros.world.obstacles import NOTHING_MOVES, MovingDiscs

_AHEAD: Final = 10.0  # time after which no encounter is predicted [s]
_CERTAIN: Final = 3.0  # standard deviations that a reachable set covers
_ROUNDING: Final = 1e-9
_ASIDE: Final = 0.1  # distance up to which somebody who sets off is not seen to [m]
_SLOWEST: Final = 0.1  # least acceleration with which somebody sets off [m/s^2]
_TRACKED: Final = 1_000_000_000  # time in which somebody who sets off is tracked again [ns]
_FORGOTTEN: Final = 6_000_000_000  # time out of sight after which they are, as movers are [ns]
_AROUND: Final = 0.3  # distance up to which they are looked for meanwhile [m]
_BESIDE: Final = 1.5  # distance from a cell occupied before in which another is not new [cells]


def within_reach(
    tracks: Sequence[MovingObject], pose: Array, speed: float
) -> tuple[MovingObject, ...]:
    """Moving objects that a robot of a speed [m/s] at a pose ``(3,)`` may meet before long."""
    return tuple(
        each
        for each in tracks
        if isinstance(each, PeerTrajectory)
        or math.hypot(each.x - pose[0], each.y - pose[1])
        - (each.radius + _CERTAIN * each.position_stddev)
        <= (math.hypot(each.vx, each.vy) + _CERTAIN * each.velocity_stddev + speed) * _AHEAD
    )


class ObstacleTracker:
    """Keeps each obstacle in its slot from one control step to the next.

    So the constraints of a plan stay those that they were, and its warm start is worth something.
    """

    def __init__(self) -> None:
        self._slots: dict[int | str, int] = {}
        self.ids: frozenset[int | str] = frozenset()  # of the last update
        self.new_obstacle_seen = False  # by the last update

    def update(
        self, stamp: int, pose: Array, tracks: Sequence[MovingObject], settings: MovingObstacles
    ) -> MovingDiscs:
        """Moving obstacles at `stamp` [ns], for a robot at `pose` ``(3,)`` [m, m, rad].

        Each is a quantile larger than it was seen, in position and in velocity.
        """
        ids = frozenset(each.id for each in tracks)
        self.new_obstacle_seen, self.ids = not ids <= self.ids, ids
        if not tracks:
            self._slots = {}
            return NOTHING_MOVES
        states = np.array([_planned(each, stamp, settings) for each in tracks])
        ways = {
            index: each.path(stamp)
            for index, each in enumerate(tracks)
            if isinstance(each, PeerTrajectory)
        }
        names = tuple(each.name for each in tracks)
        slots = np.full(len(tracks), -1, dtype=np.int64)
        discs = MovingDiscs(names, states, slots, ways)
        clearance = discs.clearance(pose).tolist()
        nearest = sorted(range(len(tracks)), key=lambda i: (clearance[i], i))
        self._assign([tracks[i].id for i in nearest[: settings.slots]], settings.slots)
        slots[:] = [self._slots.get(each.id, -1) for each in tracks]
        return discs

    def _assign(self, numbers: Sequence[int | str], capacity: int) -> None:
        kept = {each: self._slots[each] for each in numbers if each in self._slots}
        free = iter(sorted(set(range(capacity)) - set(kept.values())))
        # Those that were there before stay in the order of their slots.
        self._slots = {each: kept[each] if each in kept else next(free) for each in numbers}


def reachable_sets(
    stamp: int, tracks: Sequence[MovingObject], planned: MovingDiscs, settings: MovingObstacles
) -> MovingDiscs:
    """All places that moving obstacles may reach from `stamp` [ns] on, in the order of the tracks.

    Position and velocity are within three standard deviations, speeds and accelerations within
    their limits. Other robots keep to their plans.
    """
    if not tracks:
        return NOTHING_MOVES
    states = [
        planned.states[index] if isinstance(each, PeerTrajectory) else _reach(each, stamp, settings)
        for index, each in enumerate(tracks)
    ]
    return replace(planned, states=np.array(states))


def as_seen(
    stamp: int, tracks: Sequence[MovingObject], planned: MovingDiscs, settings: MovingObstacles
) -> MovingDiscs:
    """The same obstacles at `stamp` [ns] as large as they were seen, in the order of the tracks."""
    if not tracks:
        return NOTHING_MOVES
    exact = replace(settings, quantile=0.0, growth=0.0)
    return replace(planned, states=np.array([_planned(each, stamp, exact) for each in tracks]))


def _planned(seen: MovingObject, stamp: int, settings: MovingObstacles) -> tuple[float, ...]:
    """State of a moving object at an instant [ns], as in `MovingDiscs.states`."""
    age, growth = (stamp - seen.stamp) / NANOSECONDS, settings.growth
    if isinstance(seen, PeerTrajectory):
        # A robot that stands is where it said, however long ago.
        grown = 0.0 if seen.at_rest else growth * age
        return (*seen.position(stamp), 0.0, 0.0, settings.others_radius + grown, growth, 0.0)
    growth += settings.quantile * seen.velocity_stddev
    radius = seen.radius + settings.quantile * seen.position_stddev + growth * age
    x, y = seen.x + age * seen.vx, seen.y + age * seen.vy
    return x, y, seen.vx, seen.vy, radius, growth, 0.0


def _reach(seen: Track, stamp: int, settings: MovingObstacles) -> tuple[float, ...]:
    """The same of the places that an obstacle may reach."""
    age, bend = (stamp - seen.stamp) / NANOSECONDS, settings.max_acceleration
    vx, vy, growth = _velocities(seen, settings.max_speed)
    radius = seen.radius + _CERTAIN * seen.position_stddev + (growth + 0.5 * bend * age) * age
    return seen.x + age * vx, seen.y + age * vy, vx, vy, radius, growth + bend * age, bend


def _velocities(seen: Track, top: float) -> tuple[float, float, float]:
    """Centre and radius of the smallest disc of velocities both likely and up to `top` [m/s]."""
    spread, speed = _CERTAIN * seen.velocity_stddev, math.hypot(seen.vx, seen.vy)
    # One that is faster than anything should be has the velocity that was seen.
    if speed + spread <= top or speed - spread > top + _ROUNDING:
        return seen.vx, seen.vy, spread
    if spread >= speed + top or spread * spread >= speed * speed + top * top:
        return 0.0, 0.0, top
    if top * top >= speed * speed + spread * spread:
        return seen.vx, seen.vy, spread
    along = (speed * speed + top * top - spread * spread) / (2.0 * speed)
    scale = along / speed
    return scale * seen.vx, scale * seen.vy, math.sqrt(max(top * top - along * along, 0.0))


def time_to_walk(distance: float, acceleration: float) -> int:
    """Time in which somebody who sets off [m/s^2] has walked so far [m], in [ns]."""
    return round(math.sqrt(2.0 * distance / max(acceleration, _SLOWEST)) * NANOSECONDS)


class StandingPeople:
    """Remembers seen people whose tracks end where the grid has somebody stand from then on.

    Moving obstacles mark no cell: occupied cells beside a track belong to something else. Until
    they are tracked again, people may have set off as far as the grid does not show it: at any time
    since they were last in sight.
    """

    def __init__(self) -> None:
        # Who stood, or walked slowly, in the last sighting; and cells about who stands now: beside
        # them when they were tracked, and all that were there when they stood first.
        self._slow: dict[int, tuple[Track, Sighting]] = {}
        self._beside: dict[int, Array] = {}
        self._around: dict[int, Array] = {}
        self.standing: tuple[Track, ...] = ()

    def update(
        self,
        stamp: int,
        tracks: Sequence[MovingObject],
        sighting: Sighting,
        settings: MovingObstacles,
    ) -> None:
        """Note who moves and who has stopped at a time [ns].

        They stand where they were last tracked, as uncertain as their velocity was then.
        """
        moving = {each.id: each for each in tracks if isinstance(each, Track) and each.is_seen}
        known = {each.id: each for each in self.standing}
        for number, (each, before) in self._slow.items():
            if number not in moving:
                known[number] = replace(each, vx=0.0, vy=0.0, position_stddev=0.0)
                self._beside[number] = _occupied(each, before, _ASIDE)
                self._around[number] = _occupied(each, sighting, _AROUND)
        rested = stamp - time_to_walk(_ASIDE, settings.max_acceleration)
        standing = []
        for number, each in known.items():
            if number in moving:
                continue
            if not _is_in_sight(each, sighting):
                if stamp - each.stamp <= _FORGOTTEN:
                    standing.append(each)
                continue
            leaves = self._leaves(each, sighting)
            if leaves and rested - each.stamp <= _TRACKED:
                standing.append(each)
            elif self._is_there(each, sighting):
                if leaves:
                    # They would be tracked again by now: something else came into view.
                    self._around[number] = _occupied(each, sighting, _AROUND)
                standing.append(replace(each, stamp=rested))
        self.standing = tuple(standing)
        self._beside = {each.id: self._beside[each.id] for each in self.standing}
        self._around = {each.id: self._around[each.id] for each in self.standing}
        self._slow = {
            number: (each, sighting)
            for number, each in moving.items()
            if math.hypot(each.vx, each.vy) <= _CERTAIN * each.velocity_stddev
        }

    def _is_there(self, person: Track, sighting: Sighting) -> bool:
        """True if a newly occupied cell is where a person may be unseen."""
        return _has_new(_occupied(person, sighting, _ASIDE), self._beside[person.id], sighting)

    def _leaves(self, person: Track, sighting: Sighting) -> bool:
        """True if a cell just outside the place of a person is newly occupied."""
        return _has_new(_occupied(person, sighting, _AROUND), self._around[person.id], sighting)


def _has_new(occupied: Array, before: Array, sighting: Sighting) -> bool:
    apart = np.linalg.norm(occupied[:, None] - before, axis=-1).min(axis=1, initial=math.inf)
    return bool((apart > _BESIDE * sighting.grid.resolution).any())


def _is_in_sight(person: Track, sighting: Sighting) -> bool:
    """True if sensors look at a place beside a person."""
    return len(_cells(person, sighting, _ASIDE, Cell.FREE)) > 0


def _occupied(person: Track, sighting: Sighting, beyond: float) -> Array:
    """Occupied cells at the place of a person, or so far beyond [m], ``(K, 2)`` [m]."""
    return _cells(person, sighting, beyond, Cell.OCCUPIED)


def _cells(person: Track, sighting: Sighting, beyond: float, kind: Cell) -> Array:
    """Cells of a kind at the place of a person, or so far beyond [m], ``(K, 2)`` [m]."""
    grid, radius = sighting.grid, person.radius + beyond
    (x, y, yaw), around = grid.origin, math.ceil(radius / grid.resolution)
    places = np.empty(((2 * around + 1) ** 2, 2))
    frame = x, y, math.cos(yaw), math.sin(yaw), grid.resolution
    disc = person.x, person.y, radius
    return places[: _put_cells(places, grid.cells, int(kind), around, frame, disc)]


@allocation_free
def _put_cells(places: Array, cells: Cells, kind: int, around: int, frame: Any, disc: Any) -> int:
    """Fill in the centres of cells of a kind in a disc (x, y, radius); how many there are."""
    (left, low, cosine, sine, cell), (x, y, radius), count = frame, disc, 0
    rows, columns = cells.shape
    row = math.floor((cosine * (y - low) - sine * (x - left)) / cell) - around
    column = math.floor((cosine * (x - left) + sine * (y - low)) / cell) - around
    first, begin = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
    # Places are those of a grid that begins here.
    left = left + cosine * (begin * cell) - sine * (first * cell)
    low = low + sine * (begin * cell) + cosine * (first * cell)
    for i in range(first, min(row + 2 * around + 1, rows)):
        for j in range(begin, min(column + 2 * around + 1, columns)):
            along, across = (j - begin + 0.5) * cell, (i - first + 0.5) * cell
            place = left + cosine * along - sine * across, low + sine * along + cosine * across
            if cells[i, j] == kind and math.hypot(place[0] - x, place[1] - y) <= radius:
                places[count, 0], places[count, 1] = place
                count += 1
    return count
