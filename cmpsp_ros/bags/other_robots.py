"""Other robots of which a bag tells where they drove, and how near one robot came to them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from cmpsp_ros.bags.encounters import Encounter, encounters
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.run import Driven, driven_in
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.guidance.tracks import Track


def read_others(bag: Bag, namespaces: Iterable[str], own: str) -> dict[str, Driven]:
    """Paths of other robots by namespace: the simulator's own where there are some, else odometry.

    Args:
        bag: An open bag.
        namespaces: Of the robots; those that the bag tells nothing of are left out.
        own: Namespace that is left out.

    Raises:
        BagError: The bag is damaged.
    """
    return {
        each: driven_in(bag, each)
        for each in namespaces
        if each != own and any(f'{each}/{topic}' in bag.topics for topic in ('sim/truth', 'odom'))
    }


def meetings(
    path: Driven, others: Mapping[str, Driven], settings: GuidanceSettings
) -> Iterator[Encounter]:
    """Every part of a path with each other robot where it was meanwhile.

    Args:
        path: The path driven.
        others: As from `read_others`.
        settings: Of the robot that drove the path.
    """
    known = settings.moving_obstacles
    for namespace, other in others.items():
        for each in encounters(
            path, _tracks(other, known.others_radius), settings.robot_radius, known.timeout
        ):
            yield replace(each, name=f'robot {namespace}')


def _tracks(driven: Driven, radius: float) -> list[Track]:
    """A path as straight lines from each of its poses to the next."""
    velocities = np.diff(driven.poses[:, :2], axis=0) / driven.durations[:, None]
    rows = zip(
        driven.stamps.tolist(),
        driven.poses[:, :2].tolist(),
        [*velocities.tolist(), [0.0, 0.0]],
        strict=True,
    )
    return [Track(0, stamp, radius, x, y, vx, vy) for stamp, (x, y), (vx, vy) in rows]
