"""Homotopy classes of paths past the obstacles, and an initial trajectory for each.

No iteration revisits the side of an obstacle: a search over gaps along the road finds the choices.
"""

import math
from collections.abc import Collection, Sequence
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.homotopy.gaps import (
    HomotopyClass,
    between_samples,
    free_gaps,
    search,
    stretches_of,
)
from cmpsp_ros.guidance.planning.homotopy.road_frame import (
    SPACING,
    RoadFrame,
    elastic_band,
    frame_along,
    lengths,
    locate,
    point_at,
    road_frame,
    shortest_path,
    stretch_at,
    wrapped,
)
from cmpsp_ros.guidance.planning.initial_trajectories import (
    SHORTEST_LOOKAHEAD,
    follow_profile,
    free_turn_rate,
    largest_turn,
)
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import Robot
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import NARROW, cells_from, costs_of, evenly_spaced, lengths_to

MAX_CLASSES: Final = 8

_CLEARANCE: Final = 0.08
_CLEARANCE_FRACTION: Final = 0.25
"""Distance kept from the bounds of a gap [m], and its limit as a fraction of the gap's width."""
_TOO_LONG: Final = 100.0  # cost of each metre that is too long for the time left [m^2]
_ROUGHLY: Final = 1.1  # bound on the length of a path on a grid, relative to the shortest path
_NAMED: Final = 6  # number of sides in a message, the last of which may stand for the rest
_CELL: Final = 0.1
_MAX_CELLS: Final = 160
_AROUND: Final = 1.0
"""Cells of a searched grid: size [m], number along either side, width around all shapes [m]."""
_SMOOTHINGS: Final = 6


class GuidePath(NamedTuple):
    """A path past the obstacles ahead, one for a homotopy class."""

    homotopy_class: HomotopyClass  # side on which it passes each obstacle
    guess: Array  # controls that follow it, shape ``(N + 1, r)``
    frame: RoadFrame  # its road coordinates
    profile: Array  # lateral positions at their stations, shape ``(K,)`` [m]
    # squared distance to the centre line along it, and a penalty on the length by which it is too
    # long even as the shortest path [m^3]
    cost: float
    backward: float | None = None  # length at its beginning to drive backward [m]; None for none


def guide_paths(
    settings: LawSettings,
    space: FreeSpace,
    start: PlanStart,
    target: Target,
    durations: Array,
    limit: int = MAX_CLASSES,
    without: Collection[HomotopyClass] = (),
) -> list[GuidePath]:
    """At most `limit` paths to the goal, one a class that is not in `without`, best first."""
    frame = road_frame(settings, start, target)
    if frame.length < 2.0 * SPACING:
        return []
    space = between_samples(space, _straddled(settings, start.robot))
    gaps, edges = free_gaps(frame, space)
    at, lateral = (each.tolist() for each in frame.coordinates(space.landmarks))
    stretches = stretches_of(frame, gaps, at)
    trails = search(frame, stretches, lateral)
    if not trails and (found := searched_paths(settings, space, start, target, durations)):
        return [path for path in found if path.homotopy_class not in without]
    if not trails:
        # From a pocket, such as between an obstacle and an edge, the path leads back and around.
        stretches[0] = stretches[0]._replace(gaps=gaps[0])
        trails = search(frame, stretches, lateral)
    if not trails:
        return []
    stations = [each.stations for each in stretches]
    corridors = np.repeat([trail.gaps for trail in trails], stations, axis=1)
    spare = np.minimum(_CLEARANCE, _CLEARANCE_FRACTION * (corridors[:, :, 1] - corridors[:, :, 0]))
    low, high = corridors[:, :, 0] + spare, corridors[:, :, 1] - spare
    # A beginning or a goal off the road is no place to lead along.
    ends = (
        min(max(frame.ends[0], edges[0][0]), edges[0][1]),
        min(max(frame.ends[1], edges[-1][0]), edges[-1][1]),
    )
    profiles = elastic_band(frame, low, high, ends)
    reach = start.robot.max_speed * float(durations.sum())
    # Where time is scarce the centre line does not matter, nor where there is none.
    scarce = lengths(frame, profiles).sum(axis=1) > reach
    scarce |= not start.world.road.has_center_line
    if scarce.any():
        profiles[scarce] = shortest_path(frame, low[scarce], high[scarce], ends)
    costs = _costs(frame, profiles, reach)
    wanted = [i for i, each in enumerate(trails) if each.sides not in without]
    turn_rate = free_turn_rate(start, target, durations)
    wanted.sort(key=lambda i: (costs[i], trails[i].sides))
    return [
        GuidePath(
            trails[i].sides,
            follow_profile(settings, start, durations, frame, profiles[i], turn_rate),
            frame,
            profiles[i],
            costs[i],
        )
        for i in wanted[:limit]
    ]


def searched_paths(
    settings: LawSettings, space: FreeSpace, start: PlanStart, target: Target, durations: Array
) -> list[GuidePath]:
    """The path out of a dead end, or into one, if it is short enough; none if polar."""
    frame = road_frame(settings, start, target)
    if frame.polar:
        return []
    if (search := start.world.map_search(settings)) is not None:
        points = search.line(start.pose[:2], target.position, SPACING)
    else:
        around = between_samples(space, 0.0)
        points = searched_line(around, start.pose[:2], np.array(target.position))
    if len(points) < 2:
        return []
    line, profile = frame_along(points), np.zeros(len(points))
    if line.length > _ROUGHLY * start.robot.max_speed * float(durations.sum()):
        return []
    poses = np.column_stack([points, np.zeros(len(points))])
    homotopy_class = class_of(frame, frame.coordinates(space.landmarks), poses)
    turn_rate, back = free_turn_rate(start, target, durations), _backward(settings, start, points)
    guess = follow_profile(settings, start, durations, line, profile, turn_rate, back)
    return [GuidePath(homotopy_class, guess, line, profile, line.length, back)]


def _backward(settings: LawSettings, start: PlanStart, points: Array) -> float | None:
    """Length of a line behind the robot too narrow to turn round on [m]; None if it is ahead."""
    robot, (x, y, heading), world = start.robot, start.pose.tolist(), start.world
    ahead = points[min(round(SHORTEST_LOOKAHEAD / SPACING), len(points) - 1)]
    angle = wrapped(math.atan2(ahead[1] - y, ahead[0] - x) - heading)
    if abs(angle) < math.pi / 2.0 or robot.drives_sideways or not robot.turns_on_the_spot:
        return None
    turning = settings.circumscribed_radius + settings.safety.margin
    space = FreeSpace.of(world.road, world.shapes, turning)
    is_wide = space.at(np.column_stack([points, np.zeros(len(points))])).min(axis=1) >= 0.0
    return SPACING * float(is_wide.argmax())


def searched_line(space: FreeSpace, start: Array, goal: Array) -> Array:
    """Evenly spaced points ``(K, 2)`` of the shortest clear line on a grid [m]; (0, 2) for none."""
    low, high = _searched_area(space, start, goal)
    cell = max(_CELL, float((high - low).max()) / _MAX_CELLS)
    across, up = (np.arange(low[axis], high[axis], cell) for axis in range(2))
    points = np.stack(np.meshgrid(across, up, indexing='ij'), axis=-1)
    poses = np.column_stack([points.reshape(-1, 2), np.full(points[..., 0].size, math.nan)])
    clearance = space.at(poses).min(axis=1).reshape(points.shape[:2])
    # Where half a cell is longer than `_AROUND`, an end may round to beyond the last node.
    ends = (np.round((each - low) / cell).astype(np.int64) for each in (start, goal))
    first, last = (np.minimum(each, np.array(clearance.shape) - 1) for each in ends)
    costs = costs_of(clearance)
    # The ends are given; the search does not judge them.
    for place in (first, last):
        costs[tuple(place)] = min(costs[tuple(place)], 1.0 + NARROW)
    places = cells_from(lengths_to(costs, last), first)
    if not len(places):
        return np.empty((0, 2))
    inner = points[tuple(places[1:-1].T)]
    return evenly_spaced(np.vstack([start, inner, goal]), SPACING, _SMOOTHINGS)


def _searched_area(space: FreeSpace, start: Array, goal: Array) -> tuple[Array, Array]:
    """Lower and upper corner of the area that the shortest line is in, shape ``(2,)`` each [m].

    If it were coarse, shapes clear of the rectangle around all others do not count.
    """
    reached = np.repeat(space.reaches + space.radii, 2).reshape(-1, 2)
    begins, ends = space.centers - reached - _AROUND, space.centers + reached + _AROUND
    around = np.minimum(start, goal) - _AROUND, np.maximum(start, goal) + _AROUND
    low, high = np.nanmin([around[0], *begins], axis=0), np.nanmax([around[1], *ends], axis=0)
    if float((high - low).max()) <= _CELL * _MAX_CELLS:
        return low, high
    (low, high), before = around, -1
    while before != (count := int(((begins < high) & (ends > low)).all(axis=1).sum())):
        counted = ((begins < high) & (ends > low)).all(axis=1)
        low = np.min([low, *begins[counted]], axis=0)
        high = np.max([high, *ends[counted]], axis=0)
        before = count
    return low, high


def turning_first(
    settings: LawSettings, path: GuidePath, start: PlanStart, durations: Array
) -> Array:
    """A guess ``(N + 1, 2)`` [rad/s] that turns on the spot first, and then follows a path."""
    robot, frame, pose = start.robot, path.frame, start.pose
    if settings.max_wheel_change < math.inf or path.backward:
        return path.guess
    stretch = stretch_at(frame, 0.0, float(path.profile[0]))
    there = SHORTEST_LOOKAHEAD / max(stretch, SHORTEST_LOOKAHEAD)
    lateral = float(np.interp(there, frame.stations, path.profile))
    x, y = point_at(frame, min(there, frame.stations.item(-1)), lateral)
    turn = wrapped(math.atan2(y - pose[1], x - pose[0]) - float(pose[2]))
    fastest = robot.max_speed / robot.half_track * settings.control_period
    steps = min(math.ceil(abs(turn) / min(largest_turn(settings), fastest)), len(durations) - 1)
    if steps == 0:
        return path.guess
    time = float(durations[:steps].sum())
    rim = turn / time * robot.half_track / robot.wheel_radius
    turned = np.array([pose[0], pose[1], pose[2] + turn])
    facing = start._replace(pose=turned)
    rest = follow_profile(settings, facing, durations[steps:], frame, path.profile)
    return np.concatenate([np.tile([rim, -rim], (steps, 1)), rest])


def _straddled(settings: LawSettings, robot: Robot) -> float:
    """Distance from the nearest sample at which a path may pass an obstacle between two [m]."""
    if not settings.safety.between_samples or math.isinf(robot.max_speed):
        return 0.0
    return robot.max_speed * settings.control_period / 2.0


def _costs(frame: RoadFrame, profiles: Array, reach: float) -> list[float]:
    length = lengths(frame, profiles).sum(axis=1)
    squares = ((profiles - frame.middle) ** 2).sum(axis=1) + (np.diff(profiles) ** 2).sum(axis=1)
    costs: list[float] = (
        squares * frame.spacing + _TOO_LONG * np.maximum(0.0, length - reach)
    ).tolist()
    return costs


def class_of(frame: RoadFrame, centers: tuple[Array, Array], poses: Array) -> HomotopyClass:
    """Homotopy class of a path ``(N + 1, 3)``; `centers` are `RoadFrame.coordinates`."""
    if not len(centers[0]):
        return ()
    sides, path = np.zeros(len(centers[0])), np.empty((len(poses), 2))
    _locate_all(path, frame, np.ascontiguousarray(poses))
    _find_sides(sides, *centers, path, frame.stations.item(-1), frame.left)
    return tuple(int(side) for side in sides.tolist())


def in_words(sides: HomotopyClass, names: Sequence[str]) -> str:
    """A homotopy class for messages, which names the first few; empty if nothing is passed."""
    words = {1: 'left', -1: 'right'}
    parts = [f'{words[side]} of {name}' for side, name in zip(sides, names, strict=True) if side]
    if len(parts) > _NAMED:
        parts[_NAMED - 1 :] = [f'past {len(parts) - _NAMED + 1} more']
    return ' and '.join(filter(None, [', '.join(parts[:-1]), *parts[-1:]]))


@allocation_free
def _locate_all(path: Array, frame: RoadFrame, poses: Array) -> None:
    """Station and lateral position of each pose, the first one at station 0."""
    at, bearing = 0.0, frame.begin
    for k in range(poses.shape[0]):
        at, path[k, 1], bearing = locate(frame, poses[k, 0], poses[k, 1], at, bearing)
        path[k, 0] = at


@allocation_free
def _find_sides(
    sides: Array, stations: Array, lateral: Array, path: Array, end: float, left: float
) -> None:
    """Side of each obstacle, by the lateral position of the path beside its centre."""
    for j in range(stations.shape[0]):
        at = stations[j]
        if not 0.0 < at <= end:
            continue
        for k in range(path.shape[0] - 1):
            if path[k, 0] < at <= path[k + 1, 0]:
                here, there = path[k, 1], path[k + 1, 1]
                part = (at - path[k, 0]) / (path[k + 1, 0] - path[k, 0])
                sides[j] = left if here + part * (there - here) > lateral[j] else -left
                break
