"""Motion of people on foot: towards their waypoints, never through walls or each other.

They accelerate within a limit, and stop at the robot when they bump into it. Some give way to the
robot and to others, by a social force; the others brake for people alone.
"""

import math
from typing import Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free

_BRAKING: Final = 0.8  # fraction of the acceleration limit planned before all in the way
_BETWEEN: Final = 0.05  # gap that people leave between each other [m]
# Social force: relaxation [s], size [m/s^2], decay with the gap [m], foresight [s], turn [rad].
_RELAXATION, _PUSH, _RANGE, _FORESIGHT, _ASIDE = 0.5, 4.0, 0.35, 3.0, 0.7


@allocation_free
def choose_velocities(
    chosen: Array,  # ``(P, 2)`` [m/s]
    places: Array,  # ``(P, 2)`` [m]
    velocities: Array,  # those before, ``(P, 2)`` [m/s]
    targets: Array,  # next waypoint of each, ``(P, 2)`` [m]
    people: Array,  # radius, speed, 1 for giving way, and group, ``(P, 4)``
    edges: Array,  # as of `cast`
    posts: Array,  # discs, as of `cast`
    robot: Array,  # centres of its discs ``(D, 2)`` [m]
    robot_radius: float,
    limit: float,  # of accelerations [m/s^2]
    duration: float,  # until then [s]
) -> None:
    """Fill in velocities until the next step."""
    step = limit * duration
    for i in range(places.shape[0]):
        x, y, u, v = places[i, 0], places[i, 1], velocities[i, 0], velocities[i, 1]
        radius, top = people[i, 0], people[i, 1]
        to_x, to_y = targets[i, 0] - x, targets[i, 1] - y
        distance = math.sqrt(to_x * to_x + to_y * to_y)
        speed = min(top, math.sqrt(2.0 * _BRAKING * limit * distance))
        part = speed / max(distance, 1e-9)
        du, dv = part * to_x - u, part * to_y - v
        if people[i, 2] > 0.0:
            relaxed = duration / max(_RELAXATION, duration)
            du, dv = relaxed * du, relaxed * dv
            for j in range(places.shape[0]):
                if people[j, 3] != people[i, 3]:
                    apart = radius + people[j, 0]
                    push_x, push_y = _push(
                        x - places[j, 0], y - places[j, 1],
                        u - velocities[j, 0], v - velocities[j, 1], apart,
                    )  # fmt: skip
                    du, dv = du + duration * push_x, dv + duration * push_y
            for j in range(robot.shape[0]):
                apart = radius + robot_radius
                push_x, push_y = _push(x - robot[j, 0], y - robot[j, 1], u, v, apart)
                du, dv = du + duration * push_x, dv + duration * push_y
        part = min(1.0, step / max(math.sqrt(du * du + dv * dv), 1e-12))
        new_u, new_v = u + part * du, v + part * dv
        part = min(1.0, top / max(math.sqrt(new_u * new_u + new_v * new_v), 1e-12))
        new_u, new_v = part * new_u, part * new_v
        # No faster towards anybody, or the nearest wall, than that it can still brake before them.
        for j in range(places.shape[0]):
            if j != i:
                new_u, new_v = _braked(
                    new_u, new_v, places[j, 0] - x, places[j, 1] - y,
                    velocities[j, 0], velocities[j, 1], radius + people[j, 0], limit,
                )  # fmt: skip
        away_x, away_y, gap = _nearest_wall(x, y, radius, edges, posts)
        allowed = math.sqrt(2.0 * _BRAKING * limit * max(gap, 0.0))
        new_u, new_v = _limited(new_u, new_v, -away_x, -away_y, allowed)
        du, dv = new_u - u, new_v - v
        part = min(1.0, step / max(math.sqrt(du * du + dv * dv), 1e-12))
        u, v = u + part * du, v + part * dv
        for j in range(places.shape[0]):
            to_x, to_y, apart = places[j, 0] - x, places[j, 1] - y, radius + people[j, 0]
            squared = to_x * to_x + to_y * to_y
            if 0.0 < squared <= apart * apart:
                part = max(u * to_x + v * to_y, 0.0) / squared
                u, v = u - part * to_x, v - part * to_y
        _, _, after = _nearest_wall(x + duration * u, y + duration * v, radius, edges, posts)
        blocked = after < -radius / 2.0 and after < gap
        for j in range(robot.shape[0]):
            off_x, off_y = x - robot[j, 0], y - robot[j, 1]
            next_x, next_y = off_x + duration * u, off_y + duration * v
            squared, reach = off_x * off_x + off_y * off_y, radius + robot_radius
            nearer = next_x * next_x + next_y * next_y < squared
            blocked = blocked or (nearer and squared <= reach * reach)
        chosen[i, 0], chosen[i, 1] = (0.0, 0.0) if blocked else (u, v)


@allocation_free
def _braked(
    u: float,
    v: float,
    x: float,
    y: float,
    other_u: float,
    other_v: float,
    apart: float,
    limit: float,
) -> tuple[float, float]:
    """Velocity of somebody who can brake before another at an offset, who brakes as well [m/s]."""
    distance = max(math.sqrt(x * x + y * y), 1e-9)
    to_x, to_y = x / distance, y / distance
    leaving = max(other_u * to_x + other_v * to_y, 0.0)
    gap = max(distance - apart - _BETWEEN, 0.0)
    allowed = math.sqrt(_BRAKING * (limit * gap + leaving * leaving))
    return _limited(u, v, to_x, to_y, allowed)


@allocation_free
def _limited(u: float, v: float, to_x: float, to_y: float, top: float) -> tuple[float, float]:
    """Velocity of at most a speed in a direction [m/s]."""
    excess = max(u * to_x + v * to_y - top, 0.0)
    return u - excess * to_x, v - excess * to_y


@allocation_free
def _push(x: float, y: float, u: float, v: float, apart: float) -> tuple[float, float]:
    """Social force of another on somebody at an offset and a relative velocity [m/s^2]."""
    squared = u * u + v * v
    time = min(max(-(x * u + y * v) / max(squared, 1e-9), 0.0), _FORESIGHT)
    near_x, near_y = x + time * u, y + time * v
    gap = max(math.sqrt(near_x * near_x + near_y * near_y) - apart, 0.0)
    size = _PUSH * math.exp(-gap / _RANGE) * (1.0 - time / (2.0 * _FORESIGHT))
    # Of those who meet head on the point of closest approach tells no side.
    turned = math.atan2(y + 0.9 * time * v, x + 0.9 * time * u) + _ASIDE
    return size * math.cos(turned), size * math.sin(turned)


@allocation_free
def _nearest_wall(
    x: float, y: float, radius: float, edges: Array, posts: Array
) -> tuple[float, float, float]:
    """Direction away from the nearest wall, and the gap between it and a body [m]."""
    least, away_x, away_y = math.inf, 0.0, 0.0
    for k in range(edges.shape[0]):
        along_x, along_y = edges[k, 2] - edges[k, 0], edges[k, 3] - edges[k, 1]
        off_x, off_y = x - edges[k, 0], y - edges[k, 1]
        squared = max(along_x * along_x + along_y * along_y, 1e-18)
        part = min(max((off_x * along_x + off_y * along_y) / squared, 0.0), 1.0)
        off_x, off_y = off_x - part * along_x, off_y - part * along_y
        distance = math.sqrt(off_x * off_x + off_y * off_y)
        if distance < least:
            least, away_x, away_y = (
                distance,
                off_x / max(distance, 1e-9),
                off_y / max(distance, 1e-9),
            )
    for k in range(posts.shape[0]):
        off_x, off_y = x - posts[k, 0], y - posts[k, 1]
        distance = math.sqrt(off_x * off_x + off_y * off_y)
        if distance - posts[k, 4] < least:
            least = distance - posts[k, 4]
            away_x, away_y = off_x / max(distance, 1e-9), off_y / max(distance, 1e-9)
    return away_x, away_y, least - radius
