"""The seam between a bag and the files that hold its messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from pathlib import Path

    from rosbags.interfaces import Connection

StorageName = Literal['mcap', 'sqlite3']

NO_MESSAGE_YET = 2**63 - 1
"""What rosbag2 writes as the beginning of a bag without messages [ns]."""


@dataclass(frozen=True)
class Form:
    """How a bag is written.

    Attributes:
        storage: Format of its files.
        compressed: Whether chunks are compressed by zstd; mcap only.
        split_size: Size from which on a new file is begun [bytes]; 0 for a single file.
        split_duration: Duration after which a new file is begun [ns]; 0 for a single file.
    """

    storage: StorageName = 'mcap'
    compressed: bool = False
    split_size: int = 0
    split_duration: int = 0


class Storage(Protocol):
    """A file being written.

    Every method raises `OSError` when the disk refuses, and can be called again after that.

    Attributes:
        path: The file.
        channel_stats: Number of messages by the number of the topic.
        message_start_time: Stamp of the first message [ns].
        message_end_time: Stamp of the last message [ns], 0 when there is none.
    """

    path: Path
    channel_stats: dict[int, int]
    message_start_time: int
    message_end_time: int

    @property
    def size(self) -> int:
        """Size of the file so far, about [bytes]."""
        raise NotImplementedError

    def add_msgtype(self, connection: Connection) -> None:
        """Keep the definition of a topic's type."""
        raise NotImplementedError

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a topic, with its publishers' QoS profiles as YAML."""
        raise NotImplementedError

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Write one message."""
        raise NotImplementedError

    def flush(self) -> None:
        """Have everything written so far survive a loss of power."""
        raise NotImplementedError

    def make_room(self, metadata_size: int) -> None:
        """Give up what the disk refused, and what else must go for the file to be closed.

        Args:
            metadata_size: Room the metadata takes [bytes].

        """
        raise NotImplementedError

    def close(self, version: int, metadata: str) -> None:
        """Write the index and the bag's metadata, and close the file."""
        raise NotImplementedError

    def abort(self) -> None:
        """Close the file as it is."""
        raise NotImplementedError
