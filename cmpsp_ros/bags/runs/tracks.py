"""Moving obstacles in a bag."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import Track, TrackError, tracks_of


def read_tracks(bag: Bag, topic: str, frame_id: str | None) -> tuple[Track, ...]:
    """All messages of a topic, by id and time; none if the bag lacks the topic.

    Args:
        bag: An open bag.
        topic: Full name.
        frame_id: Frame of the messages wanted; others are left out, as the node refuses them. None:
            any frame.

    Raises:
        BagError: A message is not of its type.
    """
    found: dict[tuple[int, int], Track] = {}
    for _, message in bag.messages(topic) if topic in bag.topics else ():
        try:
            for each in tracks_of(
                message, message.header.frame_id if frame_id is None else frame_id
            ):
                found[each.key] = max(each, found.get(each.key, each))
        except TrackError:
            continue
        except (AttributeError, TypeError, ValueError) as error:
            raise BagError(f'{bag.path}: {topic}: found no obstacles there: {error}') from error
    return tuple(found[key] for key in sorted(found))


def seen_at(tracks: Iterable[Track], stamp: int, timeout: float) -> list[Track]:
    """Where moving obstacles were at an instant, as far as was known by then.

    Args:
        tracks: As from `read_tracks`.
        stamp: The instant [ns].
        timeout: Age at which one that is not seen again is forgotten [s].

    Returns:
        One track for each obstacle, brought to that instant, in the order of their numbers.
    """
    oldest = stamp - round(timeout * NANOSECONDS)
    latest = {each.id: each for each in tracks if oldest <= each.stamp <= stamp}
    return [_after(each, stamp) for each in latest.values()]


def _after(track: Track, stamp: int) -> Track:
    age = (stamp - track.stamp) / NANOSECONDS
    return replace(track, stamp=stamp, x=track.x + age * track.vx, y=track.y + age * track.vy)
