"""What the recorder answers when it is asked to flush: what is in the bag."""

from __future__ import annotations

import json
from collections import defaultdict
from dataclasses import asdict, dataclass


@dataclass
class Written:
    """What is in the bag of a topic.

    Attributes:
        count: Number of messages.
        published: When the newest of them was published, by the clock of the publisher's system
            [ns].
    """

    count: int = 0
    published: int = 0

    def add(self, published: int) -> None:
        """One more message, published at this time [ns], is in the bag."""
        self.count += 1
        self.published = max(self.published, published)


ByTopic = defaultdict[str, Written]


def to_json(written: ByTopic) -> str:
    """The answer as text."""
    return json.dumps({topic: asdict(each) for topic, each in written.items()})


def from_json(text: str) -> ByTopic:
    """The answer from its text; of any other topic there is nothing."""
    named = {topic: Written(**each) for topic, each in json.loads(text).items()}
    return defaultdict(Written, named)
