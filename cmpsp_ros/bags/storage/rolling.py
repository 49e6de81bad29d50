"""The storage files of a bag being written, one or several in sequence, and its metadata.

rosbags writes a single file; our bags may have several, and must close on a full disk. The metadata
have version 9, as rosbag2 of ROS 2 Jazzy writes it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

import yaml
from rosbags.rosbag2.metadata import dump_qos_v9

from cmpsp_ros.bags.storage.checks import INFORMATION
from cmpsp_ros.bags.storage.common import METADATA, NO_MESSAGE_YET, REFUSALS, Form, write_atomically
from cmpsp_ros.bags.storage.mcap_writer import McapStorage
from cmpsp_ros.bags.storage.sqlite import SqliteStorage

if TYPE_CHECKING:
    from pathlib import Path

    from rosbags.interfaces import Connection, ConnectionExtRosbag2

Storage = McapStorage | SqliteStorage
"""A file being written. When the disk refuses a call (`REFUSALS`), it can be repeated."""

_VERSION = 9

_TOPIC_METADATA_SIZE = 1536
"""Size of a topic in the metadata, with a few publishers [bytes]."""


@dataclass(frozen=True)
class FileSummary:
    """A storage file: its name, messages by number of the topic, first and last stamp [ns]."""

    name: str
    counts: Mapping[int, int]
    start: int
    end: int

    @classmethod
    def of(cls, storage: Storage) -> FileSummary:
        """Summary of a file being written."""
        counts = dict(storage.channel_stats)
        start = storage.message_start_time if any(counts.values()) else NO_MESSAGE_YET
        return cls(storage.path.name, counts, start, storage.message_end_time)

    @property
    def count(self) -> int:
        """Number of messages."""
        return sum(self.counts.values())


class RollingFiles:
    """Storage files, each with all topics, and the metadata of all.

    Every method raises one of `REFUSALS` when the disk refuses; data already written stay valid.
    Custom data are written when a file is closed.
    """

    def __init__(self, folder: Path, form: Form, custom: Mapping[str, str]) -> None:
        self._folder, self._form, self._custom = folder, form, custom
        self._topics: list[Connection] = []
        self._done: list[FileSummary] = []
        self._storage: Storage | None = self._begin()

    @property
    def message_count(self) -> int:
        """Number of messages written."""
        current = [] if self._storage is None else [FileSummary.of(self._storage)]
        return sum(each.count for each in [*self._done, *current])

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
        """Make everything written so far survive a loss of power."""
        if self._storage is not None:
            self._storage.flush()

    def close(self) -> None:
        """Write the index of the last file, and the metadata."""
        self._end()
        text = _as_yaml({INFORMATION: self._information(self._done)})
        write_atomically(self._folder / METADATA, text)

    def make_room(self) -> int:
        """Drop refused messages, and more for index and metadata; return the number dropped."""
        if self._storage is None:
            return 0
        before = self.message_count
        texts = sum(map(len, self._custom.values()))
        self._storage.make_room(_TOPIC_METADATA_SIZE * (len(self._topics) + 1) + texts)
        return before - self.message_count

    def abort(self) -> None:
        """Leave the last file unchanged."""
        if self._storage is not None:
            with suppress(*REFUSALS):
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
        storage.add_connection(topic, _as_yaml(_profiles(topic)).strip())

    def _is_full(self, storage: Storage, stamp: int) -> bool:
        if not any(storage.channel_stats.values()):
            return False
        size, duration = self._form.split_size, self._form.split_duration
        return (0 < size <= storage.size) or (0 < duration <= stamp - storage.message_start_time)

    def _end(self) -> None:
        if self._storage is None:
            return
        summary = FileSummary.of(self._storage)
        self._storage.close(_VERSION, _as_yaml(self._information([summary])).strip())
        self._done.append(summary)
        self._storage = None

    def _information(self, files: Sequence[FileSummary]) -> dict[str, Any]:
        """Metadata of files in order of time, in the words of rosbag2."""
        start = min(each.start for each in files)
        end = max(each.end for each in files)
        return {
            'version': _VERSION,
            'storage_identifier': self._form.storage,
            'duration': {'nanoseconds': max(0, end - start)},
            'starting_time': {'nanoseconds_since_epoch': start},
            'message_count': sum(each.count for each in files),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': each.topic,
                        'type': each.msgtype,
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': _profiles(each),
                        'type_description_hash': each.digest,
                    },
                    'message_count': sum(file.counts.get(each.id, 0) for file in files),
                }
                for each in self._topics
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [each.name for each in files],
            'files': [
                {
                    'path': each.name,
                    'starting_time': {'nanoseconds_since_epoch': each.start},
                    'duration': {'nanoseconds': max(0, each.end - each.start)},
                    'message_count': each.count,
                }
                for each in files
            ],
            'custom_data': dict(self._custom),
            'ros_distro': 'jazzy',
        }


class _Plain(yaml.SafeDumper):
    """Writes repeated values out, because not every reader of bags supports aliases."""

    def ignore_aliases(self, _data: object) -> bool:
        return True


def _as_yaml(value: Any) -> str:
    return yaml.dump(value, Dumper=_Plain, sort_keys=False, width=1 << 30)


def _profiles(topic: Connection) -> Any:
    return dump_qos_v9(list(cast('ConnectionExtRosbag2', topic.ext).offered_qos_profiles))
