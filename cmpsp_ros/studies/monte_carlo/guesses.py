"""Lines through a course as initial guesses for solvers, and the shortest clear path."""

import math
from itertools import pairwise

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.paper import Path
from cmpsp_ros.world import FreeSpace

_CELL = 0.08
_AROUND = 3.0
_NEIGHBOURS = ((1, 0), (0, 1), (1, 1), (1, -1))


def grid_path(settings: GuidanceSettings, pose: Array, spare: float) -> Array:
    """Points ``(K, 2)`` [m] to the goal, `spare` beside the margin [m]; none if none is clear."""
    ends = np.array([pose[:2], settings.goal])
    low, high = ends.min(axis=0) - _AROUND, ends.max(axis=0) + _AROUND
    across, up = (np.arange(low[axis], high[axis], _CELL) for axis in range(2))
    points = np.stack(np.meshgrid(across, up, indexing='ij'), axis=-1)
    rows, columns = len(across), len(up)
    # SciPy 1.11 searches graphs with short indices alone.
    number = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    distance = settings.robot_radius + settings.safety.margin + spare
    space = FreeSpace.of(settings.road, settings.obstacles, distance)
    cells = points.reshape(-1, 2)
    poses = np.column_stack([cells, np.full(len(cells), math.nan)])
    free = (space.at(poses).min(axis=1) > 0.0).reshape(number.shape)
    links = []
    for i, j in _NEIGHBOURS:
        here = np.s_[: rows - i, max(0, -j) : columns - max(0, j)]
        there = np.s_[i:, max(0, j) : columns + min(0, j)]
        both = free[here] & free[there]
        links.append((number[here][both], number[there][both], _CELL * math.hypot(i, j)))
    first, second = (np.concatenate([link[side] for link in links]) for side in (0, 1))
    weights = np.concatenate([np.full(len(link[0]), link[2]) for link in links])
    graph = coo_array((weights, (first, second)), shape=(number.size, number.size)).tocsr()
    begin, end = (int(((cells - each) ** 2).sum(axis=1).argmin()) for each in ends)
    found = dijkstra(graph, directed=False, indices=begin, return_predecessors=True)
    if not math.isfinite(found[0][end]):
        return np.empty((0, 2))
    path = [end]
    while path[-1] != begin:
        path.append(int(found[1][path[-1]]))
    return np.vstack([ends[:1], cells[path[-2:0:-1]], ends[1:]])


def shortest_length(settings: GuidanceSettings, pose: Array) -> float:
    """Length of the shortest clear path to the goal [m], on a grid and drawn taut, or infinity."""
    points = grid_path(settings, pose, 0.0)
    distance = settings.robot_radius + settings.safety.margin
    space = FreeSpace.of(settings.road, settings.obstacles, distance)
    here, length = 0, 0.0 if len(points) else math.inf
    while here < len(points) - 1:
        offsets = points[here + 1 :] - points[here]
        lengths, headings = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
        begins = np.column_stack([np.tile(points[here], (len(offsets), 1)), headings])
        twists = np.column_stack([lengths, np.zeros(len(offsets))])
        clear = space.along(begins, twists, np.ones(len(offsets))).min(axis=1) >= 0.0
        farthest = int(np.flatnonzero(clear).max(initial=0))
        here, length = here + 1 + farthest, length + float(lengths[farthest])
    return length


_FINE = 2000


def slalom(settings: GuidanceSettings, pose: Array) -> Path:
    """The line from a pose ``(3,)`` to the goal through the widest gaps, at a constant speed."""
    road = settings.world.annulus
    start = (float(pose[0]), float(pose[1]))
    ahead = road.angle_between(start, settings.goal)
    knots = [(0.0, math.dist(start, road.center))]
    for each in settings.obstacles:
        along = math.copysign(1.0, ahead) * road.angle_between(start, each.center)
        if 0.0 < along < abs(ahead):
            knots.append((along, _widest(settings, each.center)))
    knots = [*sorted(knots), (abs(ahead), math.dist(settings.goal, road.center))]
    angles, distances = np.array(knots).T
    turned = np.linspace(0.0, abs(ahead), _FINE)
    bearing = math.atan2(start[1] - road.center[1], start[0] - road.center[0])
    bearings = bearing + math.copysign(1.0, ahead) * turned
    away = np.interp(turned, angles, distances)[:, None]
    fine = road.center + away * np.column_stack([np.cos(bearings), np.sin(bearings)])
    return at_constant_speed(settings, pose, fine)


def at_constant_speed(settings: GuidanceSettings, pose: Array, fine: Array) -> Path:
    """A line of points ``(K, 2)`` [m] as a path from a pose ``(3,)``, at a constant speed."""
    robot = settings.robot
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(fine, axis=0), axis=1))])
    steps = round(settings.final_time / settings.control_period)
    at = np.linspace(0.0, length[-1], steps + 1)
    points = np.column_stack([np.interp(at, length, column) for column in fine.T])
    course = np.arctan2(*np.diff(points, axis=0).T[::-1])
    headings = np.unwrap(np.concatenate([[pose[2]], course]))
    turn_rates = np.diff(headings) / settings.control_period
    speed = np.full(steps, length[-1] / settings.final_time)
    controls = robot.controls(np.column_stack([speed, turn_rates]))
    within = np.clip(controls, -robot.bounds, robot.bounds)
    return Path(settings, np.column_stack([points, headings]), within)


def _widest(settings: GuidanceSettings, center: tuple[float, float]) -> float:
    """Distance from the road's centre to the middle of the widest gap abreast of a point [m]."""
    road = settings.world.annulus
    blocked = [(0.0, road.inner_radius), (road.outer_radius, math.inf)]
    for each in settings.obstacles:
        away = math.dist(each.center, road.center)
        beside = road.angle_between(center, each.center)
        across, ahead = away * math.sin(beside), away * math.cos(beside)
        if abs(across) < each.radius and ahead > 0.0:
            half = math.sqrt(each.radius**2 - across**2)
            blocked.append((ahead - half, ahead + half))
    # Obstacles already passed may reach further than the next ones.
    blocked.sort()
    ends = np.maximum.accumulate([end for _, end in blocked])
    gaps = [
        (later[0] - end, (later[0] + end) / 2.0)
        for (_, later), end in zip(pairwise(blocked), ends, strict=False)
    ]
    return float(max(gaps)[1])
