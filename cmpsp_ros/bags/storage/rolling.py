"""The storage files of a bag being written: one, or several in sequence.

rosbags writes a single file.
"""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING

from cmpsp_ros.bags.storage.folder import METADATA, write_whole
from cmpsp_ros.bags.storage.form import NO_MESSAGE_YET, Form
from cmpsp_ros.bags.storage.mcap_storage import McapStorage
from cmpsp_ros.bags.storage.metadata import (
    VERSION,
    FileSummary,
    as_yaml,
    information,
    profiles_of,
    qos_text,
)
from cmpsp_ros.bags.storage.sqlite_storage import SqliteStorage

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from rosbags.interfaces import Connection

Storage = McapStorage | SqliteStorage
"""A file being written. Both raise `OSError` when the disk refuses, and can be called again."""

_TOPIC_METADATA_SIZE = 1536
"""What a topic takes in the metadata, with a few publishers [bytes]."""


class RollingFiles:
    """Storage files, each with all topics, and the metadata of all.

    Every method raises `OSError` when the disk refuses; what has been written stays valid.

    Args:
        folder: Folder of the bag.
        form: Format, compression, and when to begin a new file.
        custom: Data kept with the bag, by key, written when a file is closed.
    """

    def __init__(self, folder: Path, form: Form, custom: Mapping[str, str]) -> None:
        self._folder, self._form, self._custom = folder, form, custom
        self._topics: list[Connection] = []
        self._done: list[FileSummary] = []
        self._storage: Storage | None = self._begin()

    @property
    def message_count(self) -> int:
        """Number of messages written."""
        files = [*self._done, *([] if self._storage is None else [_summary(self._storage)])]
        return sum(each.count for each in files)

    def add(self, topic: Connection) -> None:
        """Add a topic."""
        if self._storage is not None:
            self._introduce(self._storage, topic)
        self._topics.append(topic)

    def write(self, topic: Connection, stamp: int, raw: bytes) -> None:
        """Write one message, in a new file when the last has its size or its duration."""
        if self._storage is not None and self._is_full(self._storage, stamp):
            self._end()
        if self._storage is None:
            self._storage = self._begin()
        self._storage.write(topic, stamp, raw)

    def flush(self) -> None:
        """Have everything written so far survive a loss of power."""
        if self._storage is not None:
            self._storage.flush()

    def close(self) -> None:
        """Write the index of the last file, and the metadata."""
        self._end()
        about = information(self._form.storage, self._topics, self._done, self._custom)
        write_whole(self._folder / METADATA, as_yaml({'rosbag2_bagfile_information': about}))

    def make_room(self) -> int:
        """Drop what the disk refused, and as much more as index and metadata need.

        Returns:
            Number of messages dropped.
        """
        if self._storage is None:
            return 0
        before = self.message_count
        texts = sum(map(len, self._custom.values()))
        self._storage.make_room(_TOPIC_METADATA_SIZE * (len(self._topics) + 1) + texts)
        return before - self.message_count

    def abort(self) -> None:
        """Leave the last file unchanged."""
        if self._storage is not None:
            with suppress(OSError):
                self._storage.abort()

    def _begin(self) -> Storage:
        name = f'{self._folder.resolve().name}_{len(self._done)}'
        storage: Storage
        if self._form.storage == 'mcap':
            storage = McapStorage(self._folder / f'{name}.mcap', compressed=self._form.compressed)
        else:
            storage = SqliteStorage(self._folder / f'{name}.db3')
        for each in self._topics:
            self._introduce(storage, each)
        return storage

    def _introduce(self, storage: Storage, topic: Connection) -> None:
        same = (each for each in self._topics if each.msgtype == topic.msgtype)
        if next(same, topic) is topic:
            storage.add_msgtype(topic)
        storage.add_connection(topic, qos_text(profiles_of(topic)))

    def _is_full(self, storage: Storage, stamp: int) -> bool:
        if not any(storage.channel_stats.values()):
            return False
        size, duration = self._form.split_size, self._form.split_duration
        return (0 < size <= storage.size) or (0 < duration <= stamp - storage.message_start_time)

    def _end(self) -> None:
        if self._storage is None:
            return
        summary = _summary(self._storage)
        about = information(self._form.storage, self._topics, [summary], self._custom)
        self._storage.close(VERSION, as_yaml(about).strip())
        self._done.append(summary)
        self._storage = None


def _summary(storage: Storage) -> FileSummary:
    counts = dict(storage.channel_stats)
    start = storage.message_start_time if any(counts.values()) else NO_MESSAGE_YET
    return FileSummary(storage.path.name, counts, start, storage.message_end_time)
