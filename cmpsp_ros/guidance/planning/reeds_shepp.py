"""Initial trajectories of a robot that has to drive in order to turn: back and forth.

Shortest paths of a car that drives forward and backward: Reeds and Shepp, Optimal paths for a car
that goes both forwards and backwards, 1990; the numbers of formulas are theirs. Their lengths are
in turning radii.
"""

import math
from collections.abc import Callable, Iterator
from itertools import pairwise, product
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.planning.initial_trajectories import along_road
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.robots import Robot
from cmpsp_ros.world.roads import arc_length_to, lookahead_points

LEFT, STRAIGHT, RIGHT = 1, 0, -1

_TURNS: Final = {'L': LEFT, 'S': STRAIGHT, 'R': RIGHT}
_QUARTER: Final = math.pi / 2.0
_WIDER: Final = 1.1  # turning radius of a guess, in smallest ones: the steering needs time
_NEAR: Final = 8.0  # distance along the road from which it turns to the goal, not the road
_STRAIGHT_IN: Final = (0.0, 2.0, -2.0)  # straight ends of paths to a pose, as into a bay
_REVERSAL: Final = 1.0  # cost of a change of direction
_OF_PACE: Final = 0.6  # speed of a guess before it reaches the road, relative to the pace
_PIECE: Final = 0.2  # length of the pieces that are checked for collisions
_MAX_GUESSES: Final = 4

Solutions = Iterator[tuple[float, ...]]


class Segment(NamedTuple):
    """A part of a path: its turn, and its length, negative where it is driven backward."""

    turn: int
    length: float


Path = tuple[Segment, ...]


def has_to_turn(start: PlanStart, target: Target) -> bool:
    """True if a robot that cannot turn on the spot faces away, or is near a goal with a heading."""
    if start.robot.turns_on_the_spot or target.is_line:
        return False
    ahead, radius = _ahead(start, target), turning_radius(start.robot)
    if target.heading is not None and abs(ahead) <= _NEAR * radius:
        return True
    x, y = _points(start, target, math.copysign(radius, ahead))[0]
    bearing = math.atan2(y - start.pose[1], x - start.pose[0])
    return abs(math.remainder(bearing - float(start.pose[2]), math.tau)) > math.pi / 2.0


def manoeuvres(
    settings: LawSettings, start: PlanStart, target: Target, durations: Array
) -> list[Array]:
    """Controls ``(N + 1, r)`` that turn to goal or road by the shortest clear paths in time."""
    scored = [
        (round(depth, 1), cost_of(path), path) for depth, path in _depths(settings, start, target)
    ]
    best = sorted(scored)[:_MAX_GUESSES]
    made = (_paced(settings, start, target, durations, path) for *_, path in best)
    return [each for each in made if each is not None]


def clear_depth(settings: LawSettings, start: PlanStart, target: Target) -> float:
    """Least depth of the shortest paths in obstacles and edges with their margin [m]."""
    return min(depth for depth, _ in _depths(settings, start, target))


def _depths(
    settings: LawSettings, start: PlanStart, target: Target
) -> Iterator[tuple[float, Path]]:
    """Shortest paths with their depth in obstacles and edges with their margin [m]."""
    space = start.world.free_space(settings, settings.safety.margin)
    for path in _paths(start, target):
        yield max(0.0, -float(space.at(_poses(start, path)).min())), path


def turning_radius(robot: Robot) -> float:
    """Turning radius of guesses [m]."""
    return _WIDER * robot.half_track


def _ahead(start: PlanStart, target: Target) -> float:
    """Arc length along the road to the goal, negative against its direction [m]."""
    return arc_length_to(start.world.road, start.pose, target.position, target.heading)


def _points(start: PlanStart, target: Target, *lengths: float) -> Array:
    return lookahead_points(start.world.road, start.pose, np.array(lengths), target.position)


def _paths(start: PlanStart, target: Target) -> Iterator[Path]:
    """Paths to a goal that is near, else to the road ahead."""
    ahead, radius = _ahead(start, target), turning_radius(start.robot)
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
        place_before = place - last * radius * np.array(_direction(heading))
        for path in paths_between(start, np.array([*place_before, heading])):
            yield (*path, Segment(STRAIGHT, last)) if last else path


def paths_between(start: PlanStart, pose: Array) -> list[Path]:
    """Paths to a pose, the shortest of every word, by ascending length."""
    radius, (cosine, sine) = turning_radius(start.robot), _direction(float(start.pose[2]))
    x, y = pose[:2] - start.pose[:2]
    ahead, left = (cosine * x + sine * y) / radius, (cosine * y - sine * x) / radius
    return shortest_paths(ahead, left, float(pose[2]) - float(start.pose[2]))


def _poses(start: PlanStart, path: Path) -> Array:
    """Poses along a path, shape ``(K, 3)`` [m, m, rad]."""
    pieces = [
        Segment(turn, length / count)
        for turn, length in path
        for count in [math.ceil(abs(length) / _PIECE)]
        for _ in range(count)
    ]
    controls = np.array([_control(start.robot, each, 1.0) for each in pieces])
    return start.robot.roll_out(start.pose, controls, np.ones(len(pieces)))[1:]


def _control(robot: Robot, segment: Segment, time: float) -> Array:
    """Control ``(r,)`` that drives a segment in some time [s]."""
    turn, length = segment
    return robot.controls(np.array([turning_radius(robot) * length, turn * length]) / time)


def _paced(
    settings: LawSettings, start: PlanStart, target: Target, durations: Array, path: Path
) -> Array | None:
    """A path as controls ``(N + 1, r)``: to the goal in all the time, else before the road."""
    robot, period, lengths = start.robot, settings.control_period, [abs(s.length) for s in path]
    radius, steps = turning_radius(robot), len(durations)
    near = abs(_ahead(start, target)) <= _NEAR * radius
    if near:
        counts = [max(1, int(each / sum(lengths) * steps)) for each in lengths]
        counts[int(np.argmax(lengths))] += steps - sum(counts)
    else:
        step = _OF_PACE * settings.pace * period / radius
        counts = [math.ceil(each / step) for each in lengths]
    if min(counts) < 1 or sum(counts) > steps:
        return None
    moves = [[_control(robot, s, n * period)] * n for s, n in zip(path, counts, strict=True)]
    controls = np.concatenate(moves)
    if len(controls) == steps:
        return np.vstack([controls, controls[-1:]])
    there = robot.roll_out(start.pose, controls, durations[: len(controls)])[-1]
    later = start._replace(pose=there)
    return np.vstack([controls, along_road(settings, later, target, durations[len(controls) :])])


def _direction(heading: float) -> tuple[float, float]:
    return math.cos(heading), math.sin(heading)


def shortest_paths(x: float, y: float, heading: float) -> list[Path]:
    """Paths from the origin to a pose, the shortest of every word, by ascending length."""
    found = []
    for gear, side in product((1, -1), repeat=2):
        # Driven in the other direction, or mirrored, a word leads to another pose.
        ahead, left, turned = gear * x, side * y, gear * side * heading
        for word in _words(ahead, left, turned):
            path = tuple(
                Segment(side * turn, gear * length) for turn, length in word if abs(length) > 1e-9
            )
            found.append(path)
    return sorted(found, key=length_of)


def cost_of(path: Path) -> float:
    """Length of a path, and what its changes of direction cost."""
    reversals = sum(one.length * other.length < 0.0 for one, other in pairwise(path))
    return length_of(path) + _REVERSAL * reversals


def length_of(path: Path) -> float:
    """Length of a path."""
    return sum(abs(length) for _, length in path)


def _words(x: float, y: float, phi: float) -> Iterator[list[tuple[int, float]]]:
    """Paths that begin with a turn to the left, forward, for those words that have a solution."""
    back = x * math.cos(phi) + y * math.sin(phi), x * math.sin(phi) - y * math.cos(phi)
    for formula, is_reversed, turns, lengths in _WORDS:
        for t, u, *w, v in formula(*(back if is_reversed else (x, y)), phi):
            known = {'t': t, 'u': u, 'v': v, 'w': w[0] if w else 0.0, 'q': -_QUARTER}
            yield [(_TURNS[turn], known[each]) for turn, each in zip(turns, lengths, strict=True)]


def _left_straight_left(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.1."""
    u, t = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    v = _wrapped(phi - t)
    if t >= 0.0 and v >= 0.0:
        yield t, u, v


def _left_straight_right(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.2."""
    rho, theta = _polar(x + math.sin(phi), y - 1.0 - math.cos(phi))
    if rho >= 2.0:
        u = math.sqrt(rho**2 - 4.0)
        t = _wrapped(theta + math.atan2(2.0, u))
        v = _wrapped(t - phi)
        if t >= 0.0 and v >= 0.0:
            yield t, u, v


def _three_turns(x: float, y: float, phi: float) -> Solutions:
    """Formulas 8.3 and 8.4."""
    rho, theta = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    if rho <= 4.0:
        u = -2.0 * math.asin(rho / 4.0)
        t = _wrapped(theta + u / 2.0 + math.pi)
        if t >= 0.0:
            yield t, u, _wrapped(phi - t + u)


def _four_turns(x: float, y: float, phi: float) -> Solutions:
    """Formulas 8.7 and 8.8."""
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    rho = (2.0 + math.hypot(xi, eta)) / 4.0
    if rho <= 1.0:
        u = math.acos(rho)
        t, v = _outer_turns(u, -u, xi, eta, phi)
        if t >= 0.0 >= v:
            yield t, u, -u, v
    rho = (20.0 - xi**2 - eta**2) / 16.0
    if 0.0 <= rho <= 1.0:
        u = -math.acos(rho)
        t, v = _outer_turns(u, u, xi, eta, phi)
        if t >= 0.0 and v >= 0.0:
            yield t, u, u, v


def _outer_turns(u: float, v: float, xi: float, eta: float, phi: float) -> tuple[float, float]:
    delta = _wrapped(u - v)
    A, B = math.sin(u) - math.sin(delta), math.cos(u) - math.cos(delta) - 1.0
    theta = math.atan2(eta * A - xi * B, xi * A + eta * B)
    flips = 2.0 * (math.cos(delta) - math.cos(v) - math.cos(u)) + 3.0 < 0.0
    tau = _wrapped(theta + math.pi if flips else theta)
    return tau, _wrapped(tau - u + v - phi)


def _quarter_then_left(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.9."""
    rho, theta = _polar(x - math.sin(phi), y - 1.0 + math.cos(phi))
    if rho >= 2.0:
        r = math.sqrt(rho**2 - 4.0)
        u, t = 2.0 - r, _wrapped(theta + math.atan2(r, -2.0))
        v = _wrapped(phi - _QUARTER - t)
        if t >= 0.0 >= u and v <= 0.0:
            yield t, u, v


def _quarter_then_right(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.10."""
    rho, t = _polar(1.0 + math.cos(phi) - y, x + math.sin(phi))
    if rho >= 2.0:
        u, v = 2.0 - rho, _wrapped(t + _QUARTER - phi)
        if t >= 0.0 >= u and v <= 0.0:
            yield t, u, v


def _two_quarters(x: float, y: float, phi: float) -> Solutions:
    """Formula 8.11."""
    xi, eta = x + math.sin(phi), y - 1.0 - math.cos(phi)
    rho, _ = _polar(xi, eta)
    if rho >= 2.0:
        u = 4.0 - math.sqrt(rho**2 - 4.0)
        t = _wrapped(math.atan2((4.0 - u) * xi - 2.0 * eta, -2.0 * xi + (u - 4.0) * eta))
        v = _wrapped(t - phi)
        if u <= 0.0 <= t and v >= 0.0:
            yield t, u, v


_WORDS: Final[tuple[tuple[Callable[..., Solutions], bool, str, str], ...]] = (
    (_left_straight_left, False, 'LSL', 'tuv'),
    (_left_straight_right, False, 'LSR', 'tuv'),
    (_three_turns, False, 'LRL', 'tuv'),
    (_three_turns, True, 'LRL', 'vut'),
    (_four_turns, False, 'LRLR', 'tuwv'),
    (_quarter_then_left, False, 'LRSL', 'tquv'),
    (_quarter_then_right, False, 'LRSR', 'tquv'),
    (_quarter_then_left, True, 'LSRL', 'vuqt'),
    (_quarter_then_right, True, 'RSRL', 'vuqt'),
    (_two_quarters, False, 'LRSLR', 'tquqv'),
)
"""Formula, whether it is for the reversed path, turns, and lengths; q is a quarter backward."""


def _polar(x: float, y: float) -> tuple[float, float]:
    return math.hypot(x, y), math.atan2(y, x)


def _wrapped(angle: float) -> float:
    return math.remainder(angle, math.tau)
