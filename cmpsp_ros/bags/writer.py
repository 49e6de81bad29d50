"""Writing bags that stay readable if the writing is interrupted.

rosbags writes one file; ours may be several, each with all topics, and must close on a full disk.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self, cast

import yaml
from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition, Qos
from rosbags.rosbag2.metadata import dump_qos_v9

from cmpsp_ros.bags import custom_data
from cmpsp_ros.bags.definitions import jazzy, known_definition
from cmpsp_ros.bags.errors import BagError, UnknownTypeError
from cmpsp_ros.bags.storage import common
from cmpsp_ros.bags.storage.mcap_writer import McapStorage
from cmpsp_ros.bags.storage.sqlite import SqliteStorage

# A file being written. When the disk refuses a call (`REFUSALS`), it can be repeated.
Storage = McapStorage | SqliteStorage
_METADATA_VERSION = 9

_TOPIC_METADATA_SIZE = 1536  # size of a topic in the metadata, with a few publishers [bytes]


class _File(NamedTuple):
    """A storage file: its name, messages by number of the topic, first and last stamp [ns]."""

    name: str
    counts: Mapping[int, int]
    start: int
    end: int

    @classmethod
    def of(cls, storage: Storage) -> _File:
        counts = dict(storage.channel_stats)
        start = storage.message_start_time if any(counts.values()) else common.NO_MESSAGE_YET
        return cls(storage.path.name, counts, start, storage.message_end_time)

    @property
    def total(self) -> int:
        return sum(self.counts.values())


class BagWriter:
    """A new bag: metadata version 9, as rosbag2 of ROS 2 Jazzy writes it, and its definitions.

    As a context manager it always closes the bag, also after `KeyboardInterrupt`. Not thread-
    safe. Every method raises a `BagError` when the bag is closed or the disk refuses; what was
    written before stays valid. The folder must not exist; missing parents are made.
    """

    def __init__(self, path: Path, form: common.Form | None = None) -> None:
        self.path = path
        self._form = form or common.Form()
        self._topics: dict[str, Connection] = {}
        self._parameters: dict[str, dict[str, object]] = {}
        self._custom = {
            custom_data.VERSION_KEY: custom_data.own_version(),
            custom_data.SOFTWARE_KEY: json.dumps(custom_data.software_versions()),
            custom_data.PARAMETERS_KEY: '{}',
        }
        self._kept: dict[str, str] = {}
        self._done: list[_File] = []
        self._closed = False
        if self._form.compressed and self._form.storage != 'mcap':
            raise BagError(f'{path}: only mcap can be compressed, not {self._form.storage}')
        if path.exists():
            raise BagError(f'{path}: exists already, a new bag needs a path that does not exist')
        with self._writing('cannot create the bag'):
            path.mkdir(parents=True)
            self._lock = common.locked(path)
            self._storage: Storage | None = self._begin_file()
            os.fsync(self._lock)

    @property
    def message_count(self) -> int:
        """Number of messages written."""
        current = [] if self._storage is None else [_File.of(self._storage)]
        return sum(each.total for each in [*self._done, *current])

    def topic(
        self,
        name: str,
        msgtype: str,
        qos_profiles: Sequence[Qos] = (),
        definition: MessageDefinition | None = None,
    ) -> None:
        """Add a topic by its full name; its type is defined as in ROS 2 Jazzy if not otherwise.

        Raises UnknownTypeError without a definition: the bag goes on without the topic.
        """
        with self._writing():
            if name in self._topics:
                raise BagError(f'{self.path}: topic {name} has been added already')
            known = known_definition(msgtype)
            chosen = definition or known
            if chosen is None:
                msg = f'{self.path}: topic {name} left out: no definition of its type {msgtype}'
                raise UnknownTypeError(msg)
            digest = jazzy().hash_rihs01(msgtype) if chosen == known else ''
            number, ext = len(self._topics) + 1, ConnectionExtRosbag2('cdr', list(qos_profiles))
            topic = Connection(number, name, msgtype, chosen, digest, 0, ext, self)
            if self._storage is not None:
                self._introduce(self._storage, topic)
            self._topics[name] = topic

    def write(self, topic: str, stamp_ns: int, raw: bytes) -> None:
        """Write a serialised message (CDR) received at a time [ns], in a new file if one is due."""
        with self._writing():
            connection = self._topics.get(topic)
            if connection is None:
                raise BagError(f'{self.path}: write to topic {topic}, which has not been added')
            if self._storage is not None and self._is_full(self._storage, stamp_ns):
                self._end_file()
            if self._storage is None:
                self._storage = self._begin_file()
            self._storage.write(connection, stamp_ns, raw)

    def flush(self) -> None:
        """Make everything so far survive a loss of power: `recover` finds it in an unclosed bag."""
        with self._writing():
            if self._custom != self._kept:
                common.write_atomically(self.path / common.UNFINISHED, json.dumps(self._custom))
                self._kept = dict(self._custom)
            if self._storage is not None:
                self._storage.flush()
            os.fsync(self._lock)

    def set_parameters(self, node_name: str, values: Mapping[str, object]) -> None:
        """Keep plain parameters of a node, by its full name; floats read back bit for bit."""
        kept = {}
        for name, value in values.items():
            try:
                kept[name] = custom_data.plain(value)
            except TypeError as error:
                raise BagError(f'{self.path}: parameter {name} of {node_name} {error}') from error
        self._parameters[node_name] = kept
        self.set_custom({custom_data.PARAMETERS_KEY: json.dumps(self._parameters)})

    def set_custom(self, values: Mapping[str, str]) -> None:
        """Keep texts with the bag, by key; those of another bag that this one continues."""
        with self._writing():
            self._custom.update(values)

    def close(self) -> None:
        """Write index and metadata; closing twice is closing once.

        After the disk has refused a write, the end of the recording is given up, so that
        the rest makes a complete bag; then it raises BagError.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._close()
        finally:
            if (self.path / common.METADATA).exists():
                (self.path / common.UNFINISHED).unlink(missing_ok=True)
            os.close(self._lock)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self.close()
        except BagError:
            # The error inside the block is the cause and must not be hidden.
            if kind is None:
                raise

    def _close(self) -> None:
        try:
            self._finish()
        except common.REFUSALS as error:
            try:
                before = self.message_count
                if self._storage is not None:
                    texts = sum(map(len, self._custom.values()))
                    self._storage.make_room(_TOPIC_METADATA_SIZE * (len(self._topics) + 1) + texts)
                lost = before - self.message_count
                self._finish()
            except common.REFUSALS:
                if self._storage is not None:
                    with suppress(*common.REFUSALS):
                        self._storage.abort()
                msg = f'{self.path}: cut off, without index and metadata: {error}'
                raise BagError(msg) from error
            msg = f'{self.path}: closed without its last {lost} messages: {error}'
            raise BagError(msg) from error

    def _finish(self) -> None:
        self._end_file()
        text = _as_yaml({common.INFORMATION: self._information(self._done)})
        common.write_atomically(self.path / common.METADATA, text)

    def _begin_file(self) -> Storage:
        name = f'{self.path.resolve().name}_{len(self._done)}'
        storage: Storage
        if self._form.storage == 'mcap':
            storage = McapStorage(self.path / f'{name}.mcap', compressed=self._form.compressed)
        else:
            storage = SqliteStorage(self.path / f'{name}.db3')
        for each in self._topics.values():
            self._introduce(storage, each)
        return storage

    def _end_file(self) -> None:
        if self._storage is not None:
            file = _File.of(self._storage)
            text = _as_yaml(self._information([file])).strip()
            self._storage.close(_METADATA_VERSION, text)
            self._done.append(file)
            self._storage = None

    def _introduce(self, storage: Storage, topic: Connection) -> None:
        same = (each for each in self._topics.values() if each.msgtype == topic.msgtype)
        if next(same, topic) is topic:
            storage.add_msgtype(topic)
        storage.add_connection(topic, _as_yaml(_profiles(topic)).strip())

    def _is_full(self, storage: Storage, stamp: int) -> bool:
        if not any(storage.channel_stats.values()):
            return False
        size, duration = self._form.split_size, self._form.split_duration
        return (0 < size <= storage.size) or (0 < duration <= stamp - storage.message_start_time)

    def _information(self, files: Sequence[_File]) -> dict[str, Any]:
        """Metadata of files in order of time, in the words of rosbag2."""
        whole = _File('', {}, min(each.start for each in files), max(each.end for each in files))
        return {
            'version': _METADATA_VERSION,
            'storage_identifier': self._form.storage,
            **_times(whole),
            'message_count': sum(each.total for each in files),
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
                for each in self._topics.values()
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [each.name for each in files],
            'files': [
                {'path': each.name, **_times(each), 'message_count': each.total} for each in files
            ],
            'custom_data': dict(self._custom),
            'ros_distro': 'jazzy',
        }

    @contextmanager
    def _writing(self, what: str = 'cannot write to the bag') -> Iterator[None]:
        if self._closed:
            raise BagError(f'{self.path}: the bag is closed')
        try:
            yield
        except common.REFUSALS as error:
            raise BagError(f'{self.path}: {what}: {error}') from error


class _Plain(yaml.SafeDumper):
    """Writes repeated values out, because not every reader of bags supports aliases."""

    def ignore_aliases(self, _data: object) -> bool:
        return True


def _as_yaml(value: Any) -> str:
    return yaml.dump(value, Dumper=_Plain, sort_keys=False, width=1 << 30)


def _times(file: _File) -> dict[str, Any]:
    return {
        'starting_time': {'nanoseconds_since_epoch': file.start},
        'duration': {'nanoseconds': max(0, file.end - file.start)},
    }


def _profiles(topic: Connection) -> Any:
    return dump_qos_v9(list(cast('ConnectionExtRosbag2', topic.ext).offered_qos_profiles))
