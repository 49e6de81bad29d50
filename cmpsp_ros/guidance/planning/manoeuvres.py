"""Guesses of a robot that has to drive in order to turn: back and forth, by Reeds and Shepp."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.initial_trajectories import along_road
from cmpsp_ros.guidance.planning.reeds_shepp import STRAIGHT, Segment, length_of, shortest_paths
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.robots import Robot
from cmpsp_ros.world.roads import arc_length_to, lookahead_points

Way = tuple[Segment, ...]

_WIDER: Final = 1.1
"""Turning radius of a guess, in smallest ones: the steering needs time."""

_NEAR: Final = 8.0
"""Way along which a goal is turned to at once, in turning radii; else to the road half as far."""

_STRAIGHT_IN: Final = (0.0, 2.0, -2.0)
"""Straight ends of ways to a pose, in turning radii: a bay is entered along its heading."""

_REVERSAL: Final = 1.0
"""What a change of direction counts as much as, in turning radii."""

_OF_PACE: Final = 0.6
_PIECE: Final = 0.2
_MOST: Final = 4


def has_to_turn(start: PlanStart, target: Target) -> bool:
    """Whether a robot that cannot turn on the spot faces away, or is near a pose to meet."""
    if start.robot.turns_on_the_spot or target.is_line:
        return False
    ahead, radius = _ahead(start, target), _radius(start.robot)
    if target.heading is not None and abs(ahead) <= _NEAR * radius:
        return True
    x, y = _points(start, target, math.copysign(radius, ahead))[0]
    bearing = math.atan2(y - start.pose[1], x - start.pose[0])
    return abs(math.remainder(bearing - float(start.pose[2]), math.tau)) > math.pi / 2.0


def manoeuvres(
    settings: LawSettings, start: PlanStart, target: Target, durations: Array
) -> list[Array]:
    """Guesses that turn to the goal, or to the road to it, by the shortest ways that are clear.

    Args:
        settings: All settings of the guidance law.
        start: Where they begin.
        target: Where they lead.
        durations: Length of every step, shape ``(N,)`` [s].

    Returns:
        Controls ``(N + 1, r)`` each, none where the time is too short.
    """
    space = start.world.free_space(settings, settings.safety.margin)
    scored = []
    for way in _ways(start, target):
        poses = _poses(start, way)
        depth = max(0.0, -float(space.at(poses).min()))
        reversals = sum(one.length * other.length < 0.0 for one, other in pairwise(way))
        scored.append((round(depth, 1), length_of(way) + _REVERSAL * reversals, way))
    made = (_paced(settings, start, target, durations, way) for *_, way in sorted(scored)[:_MOST])
    return [each for each in made if each is not None]


def _radius(robot: Robot) -> float:
    """Turning radius of guesses [m]."""
    return _WIDER * robot.half_track


def _ahead(start: PlanStart, target: Target) -> float:
    """Way along the road to the goal, negative against its direction [m]."""
    return arc_length_to(start.world.road, start.pose, target.position, target.heading)


def _points(start: PlanStart, target: Target, *lengths: float) -> Array:
    return lookahead_points(start.world.road, start.pose, np.array(lengths), target.position)


def _ways(start: PlanStart, target: Target) -> Iterator[Way]:
    """Ways to the goal where that is near, else to the road ahead."""
    ahead, radius = _ahead(start, target), _radius(start.robot)
    near = abs(ahead) <= _NEAR * radius
    there = ahead if near else math.copysign(_NEAR / 2.0 * radius, ahead)
    before, place = _points(start, target, 0.9 * there, there)
    heading = math.atan2(*(place - before)[::-1])
    straight: tuple[float, ...] = (0.0,)
    if near:
        place = np.array(target.position)
        if target.heading is not None:
            heading, straight = target.heading, _STRAIGHT_IN
    for last in straight:
        x, y = place - start.pose[:2] - last * radius * np.array(_direction(heading))
        cosine, sine = _direction(float(start.pose[2]))
        ahead, left = (cosine * x + sine * y) / radius, (cosine * y - sine * x) / radius
        for way in shortest_paths(ahead, left, heading - float(start.pose[2])):
            yield (*way, Segment(STRAIGHT, last)) if last else way


def _poses(start: PlanStart, way: Way) -> Array:
    """Poses along a way, shape ``(K, 3)`` [m, m, rad]."""
    pieces = [
        Segment(turn, length / count)
        for turn, length in way
        for count in [math.ceil(abs(length) / _PIECE)]
        for _ in range(count)
    ]
    controls = np.array([_control(start.robot, each, 1.0) for each in pieces])
    return start.robot.roll_out(start.pose, controls, np.ones(len(pieces)))[1:]


def _control(robot: Robot, segment: Segment, time: float) -> Array:
    """The control, shape ``(r,)``, that drives a segment in some time [s]."""
    turn, length = segment
    return robot.controls(np.array([_radius(robot) * length, turn * length]) / time)


def _paced(
    settings: LawSettings, start: PlanStart, target: Target, durations: Array, way: Way
) -> Array | None:
    """A way as controls ``(N + 1, r)``: in all the time to the goal, else before the road."""
    robot, period, lengths = start.robot, settings.control_period, [abs(s.length) for s in way]
    radius, steps = _radius(robot), len(durations)
    near = abs(_ahead(start, target)) <= _NEAR * radius
    if near:
        counts = [max(1, int(each / sum(lengths) * steps)) for each in lengths]
        counts[int(np.argmax(lengths))] += steps - sum(counts)
    else:
        step = _OF_PACE * settings.pace * period / radius
        counts = [math.ceil(each / step) for each in lengths]
    if min(counts) < 1 or sum(counts) > steps:
        return None
    moves = [[_control(robot, s, n * period)] * n for s, n in zip(way, counts, strict=True)]
    controls = np.concatenate(moves)
    if len(controls) == steps:
        return np.vstack([controls, controls[-1:]])
    there = robot.roll_out(start.pose, controls, durations[: len(controls)])[-1]
    later = start._replace(pose=there)
    return np.vstack([controls, along_road(settings, later, target, durations[len(controls) :])])


def _direction(heading: float) -> tuple[float, float]:
    return math.cos(heading), math.sin(heading)
