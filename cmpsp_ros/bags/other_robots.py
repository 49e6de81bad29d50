"""Other robots of which a bag tells where they drove, and how near one robot came to them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace

import numpy as np

from cmpsp_ros.bags.encounters import Encounter, encounters
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.run import Driven, driven_in
from cmpsp_ros.guidance.messages.tracks import Track


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
        each: driven_in(bag, each) for each in namespaces if each != own and _is_told(bag, each)
    }


def _is_told(bag: Bag, namespace: str) -> bool:
    """Whether a bag tells where a robot drove."""
    topics = (f'{namespace}/{topic}' for topic in ('sim/truth', 'odom'))
    return any(topic in bag.topics and bag.topics[topic].count > 1 for topic in topics)


def meetings(
    path: Driven, others: Mapping[str, Driven], radius: float, timeout: float
) -> Iterator[Encounter]:
    """Every part of a path with each other robot where it was meanwhile.

    Args:
        path: The path driven.
        others: As from `read_others`.
        radius: Of the footprints of both robots together [m].
        timeout: Time for which another robot is taken to go on as it was seen last [s].
    """
    for namespace, other in others.items():
        for each in encounters(path, _tracks(other), radius, timeout):
            yield replace(each, name=f'robot {namespace}')


def _tracks(driven: Driven) -> list[Track]:
    """A path as straight lines from each of its poses to the next, of a point."""
    velocities = np.diff(driven.poses[:, :2], axis=0) / driven.durations[:, None]
    rows = zip(
        driven.stamps.tolist(),
        driven.poses[:, :2].tolist(),
        [*velocities.tolist(), [0.0, 0.0]],
        strict=True,
    )
    return [Track(0, stamp, 0.0, x, y, vx, vy) for stamp, (x, y), (vx, vy) in rows]
