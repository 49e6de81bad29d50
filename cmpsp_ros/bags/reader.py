"""Reading bags: ours, and those of `ros2 bag`."""

from __future__ import annotations

import json
import struct
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, cast

from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag2 import ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_typestore

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.writer import PARAMETERS_KEY, VERSION_KEY

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos
    from rosbags.rosbag2 import Reader

# What rosbags raises, by what it runs into, on files that are damaged.
_DAMAGE = (
    AnyReaderError,
    ReaderError,
    SerdeError,
    TypesysError,
    OSError,
    EOFError,
    ValueError,
    TypeError,
    LookupError,
    AssertionError,
    struct.error,
)


@dataclass(frozen=True)
class Topic:
    """What a bag says about one of its topics.

    Attributes:
        msgtype: Type, as in `nav_msgs/msg/Odometry`.
        count: Number of messages.
        qos_profiles: What the publishers offered when recording began.

    """

    msgtype: str
    count: int
    qos_profiles: tuple[Qos, ...]


class Bag:
    """A bag opened for reading; a context manager, closed at the end of its block.

    Args:
        path: Folder with a `metadata.yaml`, or a single mcap or sqlite3 file.

    Attributes:
        path: As given.
        topics: By full name.
        start: Stamp of the first message [ns], 0 when there is none.
        end: Stamp of the last message [ns], 0 when there is none.
        parameters: Parameters kept with the bag, `{node: {name: value}}`; empty when the bag was
            not written by this package.
        version: Version of this package that wrote the bag; empty when another program did.

    Raises:
        BagError: No such path, not a bag, cut off, or damaged.

    """

    def __init__(self, path: Path) -> None:
        self.path = path
        if not path.exists():
            msg = f'{path}: no such bag'
            raise BagError(msg)
        if path.is_dir() and not (path / 'metadata.yaml').exists():
            what = 'the recording was cut off' if any(path.glob('*.mcap')) else 'not a bag'
            msg = f'{path}: {what}: expected a metadata.yaml in this folder'
            raise BagError(msg)
        with self._readable('not a readable bag'):
            self._reader = AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY))
            self._reader.open()
        self._open = True
        try:
            with self._readable('not a readable bag'):
                self._read_summary()
        except BagError:
            self.close()
            raise

    def raw(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Iterate over a topic's messages in order of time, as recorded.

        Args:
            topic: Full name, as in `/odom`.

        Yields:
            Stamp [ns] and serialised message (CDR).

        Raises:
            BagError: No such topic, or the bag is damaged.

        """
        for _, stamp, raw in self._records(topic):
            yield stamp, raw

    def messages(self, topic: str) -> Iterator[tuple[int, Any]]:
        """Iterate over a topic's messages in order of time.

        Args:
            topic: Full name, as in `/odom`.

        Yields:
            Stamp [ns] and message, an object with the fields of its type.

        Raises:
            BagError: No such topic, or the bag is damaged.

        """
        for connection, stamp, raw in self._records(topic):
            with self._readable(f'message of {topic} at {stamp} ns cannot be read'):
                message = self._reader.deserialize(raw, connection.msgtype)
            yield stamp, message

    def close(self) -> None:
        """Close the bag; closing twice is closing once."""
        if self._open:
            self._open = False
            self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _records(self, topic: str) -> Iterator[tuple[Connection, int, bytes]]:
        if not self._open:
            msg = f'{self.path}: the bag is closed'
            raise BagError(msg)
        if topic not in self.topics:
            there = ', '.join(sorted(self.topics)) or 'no topic at all'
            msg = f'{self.path}: no topic {topic}; there is {there}'
            raise BagError(msg)
        chosen = [each for each in self._reader.connections if each.topic == topic]
        records = self._reader.messages(connections=chosen)
        while True:
            with self._readable(f'damaged in topic {topic}'):
                record = next(records, None)
            if record is None:
                return
            yield record

    def _read_summary(self) -> None:
        self.topics: dict[str, Topic] = {}
        for each in self._reader.connections:
            before = self.topics.get(each.topic)
            ext = cast('ConnectionExtRosbag2', each.ext)
            self.topics[each.topic] = Topic(
                each.msgtype,
                each.msgcount + (before.count if before else 0),
                (*(before.qos_profiles if before else ()), *ext.offered_qos_profiles),
            )
        empty = self._reader.message_count == 0
        self.start = 0 if empty else self._reader.start_time
        # rosbags counts the end as the first nanosecond after the last message.
        self.end = 0 if empty else self._reader.end_time - 1
        custom = cast('Reader', self._reader.readers[0]).storage.metadata.custom or {}
        self.version = custom.get(VERSION_KEY, '')
        self.parameters: dict[str, dict[str, Any]] = json.loads(custom.get(PARAMETERS_KEY, '{}'))

    @contextmanager
    def _readable(self, what: str) -> Iterator[None]:
        try:
            yield
        except _DAMAGE as error:
            msg = f'{self.path}: {what}: {str(error) or type(error).__name__}'
            raise BagError(msg) from error
