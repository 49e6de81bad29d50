"""Trajectories of other robots, as they publish them.

A plan comes as `nav_msgs/Path`, as `~/predicted_path` is: each pose with the time when the robot
should be there. A robot that stands publishes one pose.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.messages.checks import check_frame, is_place
from cmpsp_ros.guidance.messages.odometry import stamp_of
from cmpsp_ros.guidance.messages.tracks import Track, TrackError

MOST: Final = 10_000
"""Poses in a plan; more are none that somebody makes every control period."""


@dataclass(frozen=True, order=True)
class PeerTrajectory:
    """Where another robot intends to be.

    Attributes:
        id: Its namespace, as in `/r2`.
        stamp: When the plan was made [ns].
        stamps: When the robot will be at each place, increasing [ns].
        places: The places (x, y) [m], at least one; at the last it stays.
    """

    id: str
    stamp: int
    stamps: tuple[int, ...]
    places: tuple[tuple[float, float], ...]

    @property
    def name(self) -> str:
        """What messages call the robot."""
        return f'robot {self.id}'

    @property
    def key(self) -> tuple[str, int]:
        """What of it a decision says: the robot, and when it said so."""
        return self.id, self.stamp

    @property
    def stands(self) -> bool:
        """Whether the robot says that it stands."""
        return len(self.places) == 1

    def is_older(self, stamp: int) -> bool:
        """Whether it counts no more when plans do that were made before an instant [ns].

        A robot that stands does so until it says otherwise.
        """
        return not self.stands and self.stamp < stamp

    def way(self, stamp: int) -> Array:
        """Times from an instant [ns] on and places (t, x, y), shape ``(J, 3)`` [s, m, m]."""
        seconds = np.array([each - stamp for each in self.stamps]) / NANOSECONDS
        return np.column_stack([seconds, np.array(self.places)])

    def place(self, stamp: int) -> tuple[float, float]:
        """Where the robot is at an instant [ns], if it does what it says."""
        seconds, *places = self.way(stamp).T
        x, y = (float(np.interp(0.0, seconds, each)) for each in places)
        return x, y


Seen = Track | PeerTrajectory
"""Something that moves, as it is known."""


def plan_of(message: Any, namespace: str, frame_id: str) -> PeerTrajectory:
    """The plan in a message.

    Args:
        message: A `nav_msgs/Path`.
        namespace: Of the robot that it came from.
        frame_id: Frame in which it is wanted.

    Raises:
        TrackError: It is in another frame, has no pose, or one that is not finite or farther away
            than any on Earth, or times that do not increase; nothing of it is used then.
    """
    whose = f'The plan of {namespace}'
    check_frame(f'{whose} is', message, frame_id, TrackError)
    if not 1 <= len(message.poses) <= MOST:
        raise TrackError(f'{whose} has {len(message.poses)} poses, wanted from 1 to {MOST}.')
    positions = [each.pose.position for each in message.poses]
    places = [(float(each.x), float(each.y)) for each in positions]
    for number, (x, y) in enumerate(places):
        if not is_place(x, y):
            raise TrackError(
                f'{whose} has pose {number} at {x:.3g}, {y:.3g} m, wanted one on Earth.'
            )
    stamp, stamps = stamp_of(message), [stamp_of(each) for each in message.poses]
    if any(after <= before for before, after in pairwise(stamps)) or stamps[0] < stamp:
        raise TrackError(f'{whose} has times that do not increase.')
    if stamps[0] > stamp and len(stamps) > 1:
        # Made for when its command takes effect; until then the robot drives as it will.
        part = (stamps[0] - stamp) / (stamps[1] - stamps[0])
        (x, y), (next_x, next_y) = places[:2]
        stamps.insert(0, stamp)
        places.insert(0, (x - part * (next_x - x), y - part * (next_y - y)))
    return PeerTrajectory(namespace, stamp, tuple(stamps), tuple(places))


def plan_topic(namespace: str) -> str:
    """Where a robot publishes its plans."""
    return f'{namespace}/guidance/predicted_path'
