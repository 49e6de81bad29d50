"""The contents of the bag by topic, for the recorder's diagnostics."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

_COUNT, _NEWEST = ' messages', ' newest'


@dataclass
class Written:
    """The contents of a topic in the bag.

    Attributes:
        count: Number of messages.
        published: Time of publication of the newest, by the clock of the publisher's system [ns].
    """

    count: int = 0
    published: int = 0

    def add(self, published: int) -> None:
        """One more message, published at this time [ns], is in the bag."""
        self.count += 1
        self.published = max(self.published, published)


ByTopic = defaultdict[str, Written]


def to_values(written: ByTopic) -> dict[str, object]:
    """Figures by key."""
    values: dict[str, object] = {}
    for topic, each in written.items():
        values |= {f'{topic}{_COUNT}': each.count, f'{topic}{_NEWEST}': each.published}
    return values


def from_values(values: Mapping[str, str]) -> ByTopic:
    """What figures say; of any other topic there is nothing."""
    topics = [key.removesuffix(_COUNT) for key in values if key.endswith(_COUNT)]
    named = {
        each: Written(int(values[each + _COUNT]), int(values[each + _NEWEST])) for each in topics
    }
    return defaultdict(Written, named)
