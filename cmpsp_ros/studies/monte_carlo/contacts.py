"""Contacts of the robot with people, by the true paths of both, and the reason of each."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.robots import placed
from cmpsp_ros.simulator import cast, discs_of, edges_of
from cmpsp_ros.world.obstacles import MovingDiscs

if TYPE_CHECKING:
    from cmpsp_ros.studies.monte_carlo.driving import DrivenRun

ACTIVE: Final = 0.05  # speed of the robot above which a contact is its own doing [m/s]

ALL_HELD: Final = 'all assumptions held'
TOO_FAST: Final = 'faster than max_obstacle_speed'
TOO_SHARP: Final = 'sharper acceleration than people.max_acceleration'
OUTSIDE: Final = 'outside the field of view'
TOO_LATE: Final = 'out of sight until nearer than anybody could stop'

_ROUNDING: Final = 1e-6
_TOUCHING: Final = 0.02  # clearance below which a person may have been stopped by the robot [m]
_APART: Final = 1.0  # time without touching after which another contact begins [s]

# Time before a contact in which the assumptions of the promise must hold [s].
_LOOKING_BACK: Final = 3.0

# Time in sight after which the tracker has confirmed a person who walks, at the latest [s].
_CONFIRMED: Final = 0.6

_RAYS: Final = 9


@dataclass(frozen=True)
class Contact:
    """A contact with one person."""

    time: float  # time of the first touch, of an active contact while the robot moves [s]
    person: str  # name of the person
    speed: float  # speed of the robot then [m/s]
    # True if it is the robot's own doing: the robot moved when it began, or moved nearer to the
    # person afterwards. A robot that stood when it was run into may leave.
    is_active: bool
    reason: str  # the assumption that did not hold, or that all did; empty if it is not active

    @property
    def sentence(self) -> str:
        """The contact in words."""
        if not self.is_active:
            return f'{self.time:6.2f} s  {self.person} touches the robot at rest'
        return f'{self.time:6.2f} s  {self.person}, robot at {self.speed:.2f} m/s: {self.reason}'


@dataclass(frozen=True)
class Crowd:
    """Circumstances of a run among people."""

    scene: str  # name of its scene
    robot: str  # name of its robot
    is_noisy: bool  # true with missed returns and noise of odometry
    told: bool  # true if people are known exactly instead of seen


@dataclass(frozen=True)
class CrowdOutcome(Crowd):
    """Figures of a run among people."""

    people: int  # number of people
    contacts: tuple[Contact, ...]  # all contacts, by time
    # Arrival of the same run with people known exactly [s]; None if it does not arrive without
    # active contact, or was not made.
    told_time: float | None = None
    empty_time: float | None = None  # the same without people

    @property
    def active(self) -> list[Contact]:
        """Contacts while the robot moved."""
        return [each for each in self.contacts if each.is_active]


def clearance(driven: DrivenRun) -> Array:
    """Clearance of each arc of the robot from each person, shape ``(K, P)`` [m]."""
    arcs = driven.arcs
    found = np.full((len(arcs[0]), len(driven.people[0][1])), -math.inf)
    for k, states in enumerate(_states(driven)):
        pose, twist, duration = (each[k : k + 1] for each in arcs)
        for points, radius in driven.task.settings.bodies:
            found[k] = np.maximum(
                found[k], states.along(pose, twist, duration, np.zeros(1), points)[0] - radius
            )
    return found


def contacts(driven: DrivenRun, names: Sequence[str]) -> tuple[Contact, ...]:
    """Contacts of a run with people, by time."""
    near = clearance(driven)
    stamps = driven.stamps / NANOSECONDS
    speeds = np.array([math.hypot(*_velocity(each.twist)) for each in driven.motions[:-1]])
    found = []
    for person, name in enumerate(names):
        touching = np.flatnonzero(~(near[:, person] > 0.0))
        if not len(touching):
            continue
        parts = np.flatnonzero(np.diff(stamps[touching]) > _APART) + 1
        for episode in np.split(touching, parts):
            stood = bool(speeds[max(int(episode[0]) - 1, 0)] <= ACTIVE)
            own = np.minimum(speeds, _approach(driven, person)) if stood else speeds
            active = episode[own[episode] > ACTIVE]
            first = int(active[0] if len(active) else episode[0])
            time, speed, reason = float(stamps[first]), float(speeds[first]), ''
            if len(active):
                free = stamps[:-1][near[:, person] > _TOUCHING]
                reason = _reason(driven, person, time, free)
            found.append(Contact(time, name, speed, bool(len(active)), reason))
    return tuple(sorted(found, key=lambda each: each.time))


def _approach(driven: DrivenRun, person: int) -> Array:
    """Speed at which each arc leads towards where a person is at its beginning, ``(K,)`` [m/s]."""
    durations = driven.arcs[-1]
    found = np.zeros(len(durations))
    for k, discs in enumerate(_states(driven, slice(person, person + 1))):
        before, after = (
            max(
                float(min(discs.clearance(point)[0] for point in placed(points, each.pose)))
                - radius
                for points, radius in driven.task.settings.bodies
            )
            for each in driven.motions[k : k + 2]
        )
        found[k] = (before - after) / max(float(durations[k]), 1e-9)
    return found


def _reason(driven: DrivenRun, person: int, time: float, free: Array) -> str:
    """The first assumption of the promise that did not hold before a contact.

    A person who bumps into the robot is stopped by it: accelerations count at times ``free`` [s].
    """
    began = np.array([stamp for stamp, _ in driven.people]) / NANOSECONDS
    before = np.flatnonzero((began > time - _LOOKING_BACK) & (began <= time))
    states = np.array([driven.people[k][1][person] for k in before])
    speeds = np.hypot(states[:, 2], states[:, 3])
    assumed = driven.task.settings.moving_obstacles
    if speeds.max(initial=0.0) > assumed.max_speed + _ROUNDING:
        return TOO_FAST
    changes = np.hypot(*np.diff(states[:, 2:4], axis=0).T) / np.diff(began[before])
    changes = changes[np.isin(began[before][1:], free)]
    if changes.max(initial=0.0) > assumed.max_acceleration + _ROUNDING:
        return TOO_SHARP
    sights = [_sight(driven, int(k), person) for k in before]
    if not sights or sights[-1] is None:
        return OUTSIDE
    hidden = [index for index, seen in enumerate(sights) if not seen]
    if not hidden:
        return ALL_HELD
    appeared = min(hidden[-1] + 1, len(before) - 1)
    if None in sights:
        return OUTSIDE if not _could_stop(driven, int(before[appeared]), person) else ALL_HELD
    return ALL_HELD if _could_stop(driven, int(before[appeared]), person) else TOO_LATE


def _sight(driven: DrivenRun, step: int, person: int) -> bool | None:
    """True if any part of a person is seen at a step; None outside the field of view."""
    task = driven.task
    assert task.scanner is not None  # noqa: S101 (people are seen by scanners alone)
    stamp, states = driven.people[step]
    pose = next(each.pose for each in driven.motions if each.stamp_ns >= stamp)
    x, y, heading = pose.tolist()
    ahead, left, turned = task.scanner.pose
    x += math.cos(heading) * ahead - math.sin(heading) * left
    y += math.sin(heading) * ahead + math.cos(heading) * left
    (at_x, at_y, _, _, radius) = states[person].tolist()
    away = math.hypot(at_x - x, at_y - y)
    half = math.asin(min(radius / max(away, radius), 1.0))
    bearings = math.atan2(at_y - y, at_x - x) + 0.98 * half * np.linspace(-1.0, 1.0, _RAYS)
    relative = bearings - heading - turned
    center = (task.scanner.angle_min + task.scanner.angle_max) / 2.0
    width = (task.scanner.angle_max - task.scanner.angle_min) / 2.0
    inside = np.abs((relative - center + math.pi) % math.tau - math.pi) <= width
    if not inside.any():
        return None
    rays = np.column_stack([np.full(_RAYS, x), np.full(_RAYS, y), bearings])[inside]
    shapes = task.scenario.obstacles
    others = np.vstack([discs_of(shapes), np.delete(states, person, axis=0)])
    first, own = np.empty(len(rays)), np.empty(len(rays))
    cast(first, rays, np.zeros(len(rays)), edges_of(shapes), others)
    cast(own, rays, np.zeros(len(rays)), np.empty((0, 4)), states[person : person + 1])
    return bool((own < np.minimum(first, task.scanner.range_max)).any())


def _could_stop(driven: DrivenRun, step: int, person: int) -> bool:
    """True if a robot that sees a person at a step from then on can be at rest in time.

    Nobody is tracked before the tracker has confirmed that they move.
    """
    settings, scanner = driven.task.settings, driven.task.scanner
    assert scanner is not None  # noqa: S101 (people are seen by scanners alone)
    stamp, states = driven.people[step]
    motion = next(each for each in driven.motions if each.stamp_ns >= stamp)
    velocity, (x, y, u, v, radius) = _velocity(motion.twist), states[person].tolist()
    speed = math.hypot(*velocity)
    braking = speed / settings.robot.max_acceleration
    reaction = _CONFIRMED + 1.0 / scanner.rate + settings.control_period + settings.command_delay
    gap = math.dist(motion.pose[:2], (x, y)) - radius - settings.robot_radius
    needed = speed * (reaction + braking / 2.0) + math.hypot(u, v) * (reaction + braking)
    return gap > needed


def _velocity(twist: Array) -> tuple[float, float]:
    """Velocity ahead and to the left of a twist, of two or three parts [m/s]."""
    parts = twist.tolist()
    return parts[0], parts[1] if len(parts) > 2 else 0.0


def _states(driven: DrivenRun, chosen: slice = slice(None)) -> Iterator[MovingDiscs]:
    """Some people, all by default, where they are at the beginning of each arc."""
    began, stamps = np.array([stamp for stamp, _ in driven.people]), driven.stamps[:-1]
    steps = np.maximum(np.searchsorted(began, stamps, side='right') - 1, 0)
    for stamp, step in zip(stamps, steps.tolist(), strict=True):
        states = driven.people[step][1][chosen]
        names = tuple(str(index) for index in range(len(states)))
        rows = np.hstack([states, np.zeros((len(states), 2))])
        discs = MovingDiscs(names, rows, np.full(len(states), -1))
        yield discs.after((stamp - began[step]) / NANOSECONDS)
