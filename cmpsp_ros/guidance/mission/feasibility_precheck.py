"""Infeasible tasks, found before a run: a goal too far, a closed road, too high a speed.

All checks are conservative, a warning is never wrong; moving obstacles are not looked at.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Follow
from cmpsp_ros.guidance.mission.closed_road import closures
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import GuidanceSettings, World
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.roads import OpenFloor, Point, Road

_SPACING = 0.05  # distance of the points of a line across a map that are looked at [m]


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
