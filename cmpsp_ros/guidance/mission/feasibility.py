"""Feasibility of tasks: warnings before a run, and roads that obstacles close, where a robot waits.

All checks are conservative, a warning is never wrong; moving obstacles are not looked at. The true
gap between obstacles is no wider than a line between corners: no robot crosses a chain of them from
edge to edge where each is too narrow, and it must, where the chain is between start and goal.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance.goals import Follow, Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.approach import STANDSTILL, Approach, Contact
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.guidance.world import GuidanceSettings, World
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import OpenFloor, Point, Road, arc_length_to

_EDGES: Final = 2
_LONGEST: Final = 4.0
"""Widths of the road along which a chain may lie: where a road crosses itself, a longer one may lie
beside two parts of it."""

_SHORTEST = 0.5  # least part of the centre line's length that a way through bends has
_SPACING = 0.05  # distance of the points of a line across a map that are looked at [m]
_SOON = 3 * NANOSECONDS  # time that the robot may take to come nearer [ns]


@dataclass
class ClosedRoad:
    """Obstacles that close the road to the present goal, as far as it has been checked."""

    obstacles: frozenset[str] = frozenset()  # names of those that leave no passage between them
    goal: Point | None = None  # goal to which the road was checked (x, y) [m]; None for not at all
    wait_reason: str = ''  # reason to wait before them, a sentence; '' if none
    nearest: float = math.inf  # least distance from them so far [m]
    nearest_at: int = 0  # time of that [ns]

    def look(self, settings: LawSettings, start: PlanStart, target: Target) -> None:
        """Look whether the road is closed for the robot without its margin; once for each goal."""
        if self.obstacles or self.goal == target.position:
            return
        self.goal = target.position
        here, wanted = (float(start.pose[0]), float(start.pose[1])), 2.0 * settings.robot_radius
        found = closures(start.world.road, start.world.shapes, here, self.goal, wanted)
        self.obstacles = frozenset(name for names, _ in found for name in names)

    def update(
        self, settings: LawSettings, approach: Approach, start: PlanStart, now: int
    ) -> Contact:
        """Record the distance at `now` [ns] from what closes the road; contact with the nearest."""
        assert self.goal is not None  # noqa: S101 (something closes the road to it)
        road, pose, progress = start.world.road, start.pose, start.progress
        sense = math.copysign(1.0, arc_length_to(road, pose, self.goal, progress=progress))
        away = {}
        for shape in start.world.shapes:
            if shape.name in self.obstacles:
                along = [
                    arc_length_to(road, pose, each, progress=progress) for each in shape.corners
                ]
                least = _SHORTEST * min(sense * each for each in along)
                away[shape.name] = least - shape.radius - settings.circumscribed_radius
        contact = approach.before(away, start)
        if contact.distance < self.nearest:
            self.nearest, self.nearest_at = contact.distance, now
        return contact

    def comes_no_nearer(self, contact: Contact, now: int) -> bool:
        """True if the robot stands before it, or has not come nearer for a while at `now` [ns]."""
        return contact.speed < STANDSTILL or now - self.nearest_at > _SOON

    def wait_before(self, contact: Contact) -> str:
        """Wait from now on; why, in a sentence."""
        self.wait_reason = f'The road is closed at {contact.name}: the robot waits before it.'
        return self.wait_reason


def closures(
    road: Road, obstacles: Sequence[Shape], start: Point, goal: Point, wanted: float
) -> Iterator[tuple[list[str], float]]:
    """Chains of obstacles that no disc of diameter `wanted` passes: names, widest gap [m]."""
    if not road.has_center_line:
        return
    # A map has no corners, and is not one obstacle but many.
    obstacles = [each for each in obstacles if each.corners]
    gaps = _gaps(road, tuple(obstacles))
    if not ((gaps < wanted) | (gaps <= 0.0)).any():
        return
    pose = np.array([*start, math.nan])
    whole = arc_length_to(road, pose, goal)
    places = [[arc_length_to(road, pose, each) for each in shape.corners] for shape in obstacles]
    between = [
        index
        for index, each in enumerate(places)
        if all(0.0 < place / (whole or math.inf) < 1.0 for place in each)
    ]
    kept = [*range(_EDGES), *(_EDGES + index for index in between)]
    gaps = gaps[np.ix_(kept, kept)]
    is_closed = (gaps < wanted) | (gaps <= 0.0)
    while chain := _chain(is_closed):
        links = [float(gaps[a, b]) for a, b in pairwise(chain)]
        along = [place for each in chain[1:-1] for place in places[between[each - _EDGES]]]
        if max(along) - min(along) <= _LONGEST * road.width:
            names = [obstacles[between[each - _EDGES]].name for each in chain[1:-1]]
            yield names, max(0.0, *links)
        is_closed[chain[1:-1]] = is_closed[:, chain[1:-1]] = False


@lru_cache(maxsize=8)
def _gaps(road: Road, shapes: tuple[Shape, ...]) -> Array:
    """Widths of gaps ``(2 + M, 2 + M)``, both edges first [m]; slow on a map, so cached."""
    space, count = FreeSpace.of(road, shapes, 0.0), _EDGES + len(shapes)
    gaps = np.full((count, count), math.inf)
    whole = 1.0 / road.clearance_scale
    for index, shape in enumerate(shapes, _EDGES):
        corners = [space.at(np.array([[*each, 0.0]]))[0] for each in shape.corners]
        away = np.min(corners, axis=0)
        away[:_EDGES] *= whole
        away -= shape.radius
        away[index] = math.inf
        gaps[index] = np.minimum(gaps[index], away)
        gaps[:, index] = np.minimum(gaps[:, index], away)
    gaps.flags.writeable = False
    return gaps


def _chain(is_closed: BoolArray) -> list[int]:
    """A shortest chain from one edge to the other; empty where there is none."""
    chains, known = [[0]], {0}
    for chain in chains:
        for following in np.flatnonzero(is_closed[chain[-1]]).tolist():
            if following == 1:
                return [*chain, following]
            if following not in known:
                known.add(following)
                chains.append([*chain, following])
    return []


def shortest_time(settings: LawSettings, road: Road, start: Point) -> float:
    """Least time to the goal without obstacles [s]; 0 without a wheel limit."""
    return _way(settings, road, start) / settings.robot.max_speed


def infeasibility_warnings(settings: LawSettings, world: World, start: Point) -> list[str]:
    """Warnings about an infeasible task, from a start (x, y) [m]; empty if none."""
    if settings.follow is not None:
        return list(_too_fast(settings, world.road, settings.follow))
    said: list[str] = []
    begin = 0.0
    for goal in settings.goals:
        # With one goal the settings are its own already.
        leg = settings.towards(goal, begin) if settings.waypoints else settings
        to = f'On the way to {goal.name}: '
        found = (
            *_too_far(leg, world.road, start),
            *_too_near(leg, world),
            *_closed(leg, world, start),
        )
        said += [to + each if settings.waypoints else each for each in found]
        start, begin = goal.position, goal.time
    return said


def _way(settings: LawSettings, road: Road, start: Point) -> float:
    kept = settings.inscribed_radius + settings.safety.margin
    way = road.shortest_length(start, settings.goal, kept)
    return max(way - settings.goal_tolerance, 0.0)


def _too_far(settings: LawSettings, road: Road, start: Point) -> Iterator[str]:
    if settings.is_soonest:
        return
    needed, final_time = shortest_time(settings, road, start), settings.final_time
    if needed > final_time:
        speed, way = settings.robot.max_speed, _way(settings, road, start)
        yield (
            f'The goal is out of reach by {way - speed * final_time:.2f} m: the shortest way is'
            f' {way:.2f} m, and this robot drives at most {speed:.3g} m/s for {final_time:g} s.'
            f' final_time would have to be {math.ceil(10.0 * needed) / 10.0:.1f} s or more.'
        )


def _too_near(settings: LawSettings, world: World) -> Iterator[str]:
    """Warning about a goal that no plan reaches within its tolerance and with the margin."""
    space = FreeSpace.of(world.road, world.obstacles, settings.inscribed_radius)
    clearances = space.at(np.array([[*settings.goal, settings.goal_heading or 0.0]]))[0]
    nearest = int(np.argmin(clearances))
    if clearances[nearest] + settings.goal_tolerance < settings.safety.margin:
        yield (
            f'At the goal the robot is {max(clearances[nearest], 0.0):.3f} m from'
            f' {world.names[nearest]}, nearer than safety.margin, {settings.safety.margin:g} m:'
            ' the plan will end beside the goal.'
        )


def _too_fast(settings: LawSettings, road: Road, follow: Follow) -> Iterator[str]:
    """Warnings about the speed on a road without end, and the acceleration to start with.

    No path is shorter than the centre line by more than half the width times all that it turns.
    """
    robot = settings.robot
    line = road.center_line()
    steps = np.diff(line, axis=0, append=line[:1])
    steps = steps[np.hypot(*steps.T) > 0.0]
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    turns = np.angle(np.exp(1j * np.diff(headings, append=headings[:1])))
    aside = road.width / 2.0 - settings.inscribed_radius - settings.safety.margin
    shortest = max(road.lap - aside * float(np.abs(turns).sum()), 0.0)
    wanted = abs(follow.speed)
    # A robot that drives sideways need not turn, and turning does not slow a car.
    slowed = robot.turns_on_the_spot and not robot.drives_sideways
    arm = robot.half_track if slowed else 0.0
    largest = robot.max_speed * road.lap / (shortest + arm * abs(float(turns.sum())))
    if wanted > largest:
        yield (
            f'follow.speed is out of reach: round this road the wheels allow {largest:.3g} m/s at'
            f' most, and {wanted:.3g} m/s are wanted.'
        )
    gain = robot.max_acceleration
    if gain == math.inf:
        return
    time = min(follow.horizon, robot.max_speed / gain)
    reach = gain * time * time / 2.0 + gain * time * (follow.horizon - time)
    needed = wanted * follow.horizon * shortest / road.lap
    if reach < needed:
        yield (
            f'follow.horizon is too short to set out: from rest the robot drives {reach:.3g} m in'
            f' {follow.horizon:.3g} s, and {needed:.3g} m are wanted.'
        )


def _closed(settings: LawSettings, world: World, start: Point) -> Iterator[str]:
    wanted = 2.0 * settings.kept
    search = world.map_search(settings)
    if search is not None:
        way = f'way from ({start[0]:.3g}, {start[1]:.3g}) m to the goal'
        line = search.line(np.array(start), settings.goal, _SPACING)
        space = FreeSpace.of(OpenFloor(), search.obstacles, settings.robot_radius)
        left = space.at(np.column_stack([line, np.zeros(len(line))]))[1:-1, 2:].min(initial=np.inf)
        if not len(line):
            width = 2.0 * settings.robot_radius
            yield f'The map leaves no {way} for this robot, which is {width:.3f} m wide.'
        elif left < settings.safety.margin - search.grid.grid.resolution / 2.0:
            yield (
                f'The map leaves no {way} with safety.margin, {settings.safety.margin:g} m on'
                f' either side: {max(left, 0.0):.3f} m at most.'
            )
    radius = "its discs' radius" if settings.footprint.corners else 'robot.radius'
    for names, gap in closures(world.road, world.shapes, start, settings.goal, wanted):
        what = (
            f'There is no way past obstacle {names[0]}: the wider gap beside it'
            if len(names) == 1
            else f'There is no way past obstacles {", ".join(names)}: the widest gap'
        )
        yield (
            f'{what} is {gap:.3f} m, and this robot needs {wanted:.3f} m'
            f' (twice {radius} and safety.margin).'
        )


def reason_not_to_begin(settings: GuidanceSettings, pose: Array) -> str:
    """Why no run begins at a pose ``(x, y, heading)`` [m, m, rad], in a sentence; or nothing."""
    limit = settings.start_tolerance
    if settings.start_pose is not None:
        distance, where = math.dist(pose[:2].tolist(), settings.start_pose[:2]), 'from start.pose'
    else:
        distance, where = _distance_from_road(settings, pose), 'off the road'
    if distance <= limit:
        return ''
    return (
        f'The robot is {distance:.3g} m {where}, more than {limit:.3g} m (start.tolerance):'
        ' no run begins there.'
    )


def _distance_from_road(settings: GuidanceSettings, pose: Array) -> float:
    """Distance beyond the edges or the ends of the road [m]; 0 on it."""
    road = settings.road
    beside = (-FreeSpace.of(road, (), 0.0).at(pose[None])[0]).tolist()
    return float(max(0.0, road.beyond((float(pose[0]), float(pose[1]))), *beside))
