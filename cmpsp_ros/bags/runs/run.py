"""A recorded run as arrays: decisions, commands, the driven path and the goals."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.decision_record import DecisionRecord, read_decisions
from cmpsp_ros.bags.reader import ALWAYS, Bag, Window
from cmpsp_ros.guidance import NANOSECONDS, Goal, GuidanceSettings
from cmpsp_ros.guidance.messages import Track, TrackError, heading_of, tracks_of
from cmpsp_ros.robots.motion import arc_ends, plain
from cmpsp_ros.sensing import stamp_of
from cmpsp_ros.world.roads import arc_length_to

_PERIODS = 1.5  # control periods for which what own sensors have seen counts


class ReceivedTracks(NamedTuple):
    """Moving obstacles of a topic."""

    tracks: tuple[Track, ...]  # by id and time
    refused: str  # messages that cannot be used, in a sentence; empty if there are none


def read_tracks(
    bag: Bag, topic: str, frame_id: str | None, window: Window = ALWAYS
) -> ReceivedTracks:
    """Messages of a topic in a frame, or in any; none if it is not there."""
    found: dict[tuple[int, int], Track] = {}
    refused: list[TrackError] = []
    for _, message in bag.messages(topic, window) if topic in bag.topics else ():
        try:
            for each in tracks_of(
                message, message.header.frame_id if frame_id is None else frame_id
            ):
                found[each.key] = max(each, found.get(each.key, each))
        except TrackError as error:
            refused.append(error)
        except (AttributeError, TypeError, ValueError) as error:
            raise bag.error(f'{topic}: found no obstacles there: {error}') from error
    said = ''
    if refused:
        count = f'{len(refused)} of {bag.topics[topic].count}'
        said = f'{count} messages in {topic} cannot be used: {refused[0]}'
    return ReceivedTracks(tuple(found[key] for key in sorted(found)), said)


def seen_at(tracks: Iterable[Track], stamp: int, settings: GuidanceSettings) -> list[Track]:
    """Moving obstacles known at an instant [ns] and not forgotten, brought to it, by number."""
    latest = {
        each.id: each
        for each in tracks
        if 0 <= stamp - each.stamp <= round(lifetime(each, settings) * NANOSECONDS)
    }
    ages = {number: (stamp - each.stamp) / NANOSECONDS for number, each in latest.items()}
    return [
        replace(
            each,
            stamp=stamp,
            x=each.x + ages[number] * each.vx,
            y=each.y + ages[number] * each.vy,
            position_stddev=each.position_stddev + ages[number] * each.velocity_stddev,
        )
        for number, each in latest.items()
    ]


def lifetime(track: Track, settings: GuidanceSettings) -> float:
    """Time for which a track counts without being seen again [s]; own sensors say it sooner."""
    return (
        _PERIODS * settings.control_period if track.is_seen else settings.moving_obstacles.timeout
    )


@dataclass(frozen=True)
class Planned:
    """A plan as published on `~/predicted_path`."""

    stamp: int  # time at which it was made [ns]
    stamps: IntArray  # time of each pose [ns], shape ``(N + 1,)``
    poses: Array  # shape ``(N + 1, 3)`` [m, m, rad]

    @property
    def points(self) -> Array:
        """Predicted positions ``(N + 1, 2)`` [m]."""
        return self.poses[:, :2]


@dataclass(frozen=True)
class DrivenPath:
    """The driven path, as arcs of constant wheel speeds."""

    stamps: IntArray  # beginning of each arc, and the end of the last [ns], shape ``(K + 1,)``
    poses: Array  # pose at each, shape ``(K + 1, 3)`` [m, m, rad]
    twists: Array  # twist after each, shape ``(K + 1, 2)`` or ``(K + 1, 3)``; see `Robot`

    @property
    def durations(self) -> Array:
        """Length of each arc, shape ``(K,)`` [s]."""
        return np.asarray(np.diff(self.stamps) / NANOSECONDS)

    def at(self, stamp: int) -> Array:
        """Pose ``(3,)`` at an instant between the first stamp and the last, on its arc."""
        return np.asarray(self.at_all(np.array([stamp], dtype=np.int64))[0])

    def at_all(self, stamps: IntArray) -> Array:
        """As `at`, for several instants: shape ``(S, 3)``."""
        index = np.searchsorted(self.stamps, stamps, side='right') - 1
        since = (stamps - self.stamps[index]) / NANOSECONDS
        return np.asarray(arc_ends(self.poses[index], self.twists[index], since))

    def chosen(self, index: NDArray[np.intp]) -> DrivenPath:
        """Some of the arcs."""
        return DrivenPath(self.stamps[index], self.poses[index], self.twists[index])

    def between(self, first: int, last: int) -> DrivenPath:
        """The part of the path between two instants."""
        inside = (self.stamps > first) & (self.stamps < last)
        index = np.searchsorted(self.stamps, [first, last], side='right') - 1
        return DrivenPath(
            np.concatenate([[first], self.stamps[inside], [last]]),
            np.vstack([self.at(first), self.poses[inside], self.at(last)]),
            np.vstack([self.twists[index[0]], self.twists[inside], self.twists[index[1]]]),
        )


@dataclass(frozen=True)
class Run:
    """A recorded run; plans are empty if they were not recorded."""

    decisions: tuple[DecisionRecord, ...]
    plans: tuple[Planned, ...]
    driven: DrivenPath
    tracks: tuple[Track, ...]  # moving obstacles as received, by id and time
    people: tuple[Track, ...]  # the simulator's people as they truly were, by number and time
    wheel_stamps: IntArray  # stamps of the wheel speeds [ns], shape ``(W,)``
    wheel_speeds: Array  # driven or, without a simulator, commanded, ``(W, wheels)`` [rad/s]

    @property
    def told(self) -> tuple[Track, ...]:
        """Moving obstacles but for those that own sensors have seen."""
        return tuple(each for each in self.tracks if not each.is_seen)


def read_run(path: Path, namespace: str = '') -> Run:
    """Read a run of our nodes, in a namespace as `/r1`, from its bag."""
    with Bag(path) as bag:
        decided = f'{namespace}/guidance/decision'
        decisions = read_decisions(bag, decided)
        if not decisions:
            found = 'no decision in' if decided in bag.topics else 'no topic'
            raise bag.lacks(f'{found} {decided}')
        plans = plans_in(bag, f'{namespace}/guidance/predicted_path')
        node = 'sim' if f'{namespace}/sim/truth' in bag.topics else 'guidance'
        stamps, speeds = _wheels(bag, f'{namespace}/{node}/wheel_speeds')
        moving = bag.as_decided_on(f'{namespace}/guidance', 'moving_obstacles')
        told, seen, people = (
            read_tracks(bag, each, None).tracks
            for each in (moving, f'{namespace}/guidance/tracks', f'{namespace}/sim/people')
        )
        driven = driven_in(bag, namespace)
        return Run(decisions, plans, driven, told + seen, people, stamps, speeds)


def driven_in(bag: Bag, namespace: str) -> DrivenPath:
    """The driven path in the frame of the course: the simulator's own, or that of odometry."""
    heard = bag.as_decided_on(f'{namespace}/guidance', 'odom')
    topic = truth_topic(bag, namespace, heard) or heard
    bag.require_type(topic, 'nav_msgs/msg/Odometry')
    rows: dict[int, tuple[list[float], list[float]]] = {}
    for _, message in bag.messages(topic):
        # Of two at one instant the later counts: a command took effect there.
        pose, twist = message.pose.pose, message.twist.twist
        place = [pose.position.x, pose.position.y, heading_of(pose.orientation)]
        rows[stamp_of(message)] = place, [twist.linear.x, twist.linear.y, twist.angular.z]
    if len(rows) < 2:
        raise bag.error(f'found {len(rows)} messages in {topic}, wanted at least 2')
    ordered = sorted(rows.items())
    return DrivenPath(
        np.array([stamp for stamp, _ in ordered], dtype=np.int64),
        np.array([pose for _, (pose, _) in ordered]),
        plain(np.array([twist for _, (_, twist) in ordered])),
    )


def truth_topic(bag: Bag, namespace: str, odom: str) -> str:
    """Topic of the true path; '' if none is in the frame of the odometry received."""
    truth = f'{namespace}/sim/truth'
    return truth if truth in bag.topics and odom == f'{namespace}/odom' else ''


def plans_in(bag: Bag, topic: str, window: Window = ALWAYS) -> tuple[Planned, ...]:
    """The plans that a bag has in a topic; none if it has no such topic."""
    plans = []
    bag.require_type(topic, 'nav_msgs/msg/Path')
    for _, message in bag.messages(topic, window) if topic in bag.topics else ():
        poses = [
            (each.pose.position.x, each.pose.position.y, heading_of(each.pose.orientation))
            for each in message.poses
        ]
        # One pose is where the robot stands.
        if len(poses) > 1:
            stamps = np.array([stamp_of(each) for each in message.poses], dtype=np.int64)
            plans.append(Planned(stamp_of(message), stamps, np.array(poses)))
    return tuple(plans)


def _wheels(bag: Bag, topic: str) -> tuple[IntArray, Array]:
    rows = [(stamp_of(message), message.velocity) for _, message in bag.messages(topic)]
    stamps = np.array([stamp for stamp, _ in rows], dtype=np.int64)
    return stamps, np.array([speeds for _, speeds in rows]).reshape(len(rows), -1)


@dataclass(frozen=True)
class Passing:
    """Position at the time of a goal [ns]: distance [m] and heading error [rad] or None."""

    goal: Goal
    stamp: int
    miss: float
    heading_miss: float | None
    ratio: float  # the larger of both errors, each divided by its tolerance

    @classmethod
    def of(cls, settings: GuidanceSettings, goal: Goal, stamp: int, pose: Array) -> Passing:
        """Measure it at a pose ``(3,)`` [m, m, rad]."""
        miss, off = math.dist(pose[:2], goal.position), None
        ratio = miss / settings.goal_tolerance
        if goal.heading is not None:
            off = abs(math.remainder(float(pose[2]) - goal.heading, math.tau))
            ratio = max(ratio, off / settings.heading_tolerance)
        return cls(goal, stamp, miss, off, ratio)

    def __str__(self) -> str:
        """Both misses in words."""
        where = self.goal.name if self.goal.name not in ('', 'goal') else 'the goal'
        turned = '' if self.heading_miss is None else f' and {round(self.heading_miss, 6):.3g} rad'
        return f'{round(self.miss, 6):.3g} m{turned} from {where}'


def mean_speed(settings: GuidanceSettings, poses: Array, seconds: float) -> float:
    """Mean speed along the centre line, negative against its direction [m/s], of close poses."""
    steps = (
        arc_length_to(settings.road, before, tuple(after[:2].tolist()), float(after[2]))
        for before, after in pairwise(poses)
    )
    return sum(steps) / seconds


def goals_driven_to(
    decisions: Sequence[DecisionRecord], settings: GuidanceSettings
) -> list[tuple[int, Goal]]:
    """Goals with the stamps [ns] from which they were current; none on a followed road."""
    if settings.follow is not None:
        return []
    alone = Goal(settings.goal, settings.final_time, settings.goal_heading)
    same = groupby(decisions, key=lambda each: each.goal or alone)
    return [(next(group).stamp, goal) for goal, group in same]
