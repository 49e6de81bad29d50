"""Recovery of messages from storage files that were cut off, never closed, or damaged.

rosbags reads complete files only.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from contextlib import closing, suppress
from dataclasses import dataclass
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from cmpsp_ros.bags.storage.limits import MAX_TOPICS, check_file, check_yaml, inflated_allowed
from cmpsp_ros.bags.storage.mcap_records import (
    CHANNEL,
    CHUNK,
    FOOTER,
    MAGIC,
    MESSAGE,
    SCHEMA,
    Fields,
    McapRecord,
    chunk,
    content,
    inner,
    message,
    records,
)
from cmpsp_ros.bags.storage.sqlite_checks import check_tables

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import BinaryIO

    from rosbags.interfaces import Qos

    Remark = Callable[[str], None]

_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}


@dataclass(frozen=True)
class FoundTopic:
    """A topic, as its storage file describes it.

    Attributes:
        name: Full name.
        msgtype: Type of its messages.
        definition: Definition of the type; None where the file has none.
        qos_profiles: What its publishers offered.
    """

    name: str
    msgtype: str
    definition: MessageDefinition | None
    qos_profiles: tuple[Qos, ...]


Found = tuple[FoundTopic, int, bytes] | FoundTopic
"""A topic, or a message of it with its stamp [ns]."""


def salvage(path: Path, folder: Path, remark: Remark) -> Iterator[Found]:
    """Iterate over the topics and messages in a storage file, as far as it is readable.

    Args:
        path: An mcap or sqlite3 file; it is not changed.
        folder: Folder with space for a copy of it.
        remark: Called with what was left out, and why.

    Yields:
        Topics, each before its messages, and messages in the order of writing.

    Raises:
        OSError: The file cannot be read.
    """
    try:
        check_file(path)
    except ReaderError as error:
        remark(str(error))
        return
    yield from (_from_mcap if path.suffix == '.mcap' else _from_sqlite)(path, folder, remark)


def _from_mcap(path: Path, _folder: Path, remark: Remark) -> Iterator[Found]:
    end = path.stat().st_size
    found = _Channels(remark, path.name)
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            remark(f'{path.name}: not an mcap file')
            return
        last = McapRecord(0, len(MAGIC), 0)
        for record in records(file, len(MAGIC), end):
            last = record
            yield from _from_record(file, record, end, found)
        if last.opcode != FOOTER:
            remark(f'{path.name}: cut off or damaged at byte {min(last.end, end)} of {end}')


def _from_record(file: BinaryIO, record: McapRecord, end: int, found: _Channels) -> Iterator[Found]:
    partly = record.end > end
    if partly:
        record = record._replace(size=end - record.body)
    if record.opcode not in {SCHEMA, CHANNEL, MESSAGE, CHUNK} or (
        partly and record.opcode != CHUNK
    ):
        return
    try:
        body = content(file, record)
        if record.opcode != CHUNK:
            yield from found.take(record.opcode, body)
            return
        inflated = chunk(body, partly=partly).data
        found.grow(len(inflated), inflated_allowed(end))
    except (ReaderError, ValueError) as error:
        found.remark(f'{found.name}: left out a record at byte {record.body}: {error}')
        return
    for opcode, each in inner(inflated):
        yield from found.take(opcode, each)


class _Channels:
    """The topics found so far in an mcap file, by number."""

    def __init__(self, remark: Remark, name: str) -> None:
        self.remark, self.name = remark, name
        self._schemas: dict[int, tuple[str, MessageDefinition | None]] = {}
        self._topics: dict[int, FoundTopic] = {}
        self._inflated = 0

    def grow(self, size: int, allowed: int) -> None:
        """Count the bytes of an uncompressed chunk.

        Raises:
            ReaderError: There are more by now than allowed.
        """
        self._inflated += size
        if self._inflated > allowed:
            raise ReaderError(f'more than {allowed} bytes uncompressed')

    def take(self, opcode: int, body: bytes) -> Iterator[Found]:
        """Process a record; yields its contents."""
        try:
            if opcode == SCHEMA:
                self._schema(Fields(body))
            elif opcode == CHANNEL:
                yield from self._channel(Fields(body))
            elif opcode == MESSAGE:
                channel, stamp, raw = message(body)
                if channel in self._topics:
                    yield self._topics[channel], stamp, raw
        except (ReaderError, ValueError, LookupError, TypeError) as error:
            self.remark(f'{self.name}: left out a damaged record: {error}')

    def _schema(self, fields: Fields) -> None:
        number, name, encoding = fields.uint(2), fields.text(), fields.text()
        self._schemas[number] = name, _definition(encoding, fields.text())

    def _channel(self, fields: Fields) -> Iterator[Found]:
        number, schema, name = fields.uint(2), fields.uint(2), fields.text()
        if number in self._topics or len(self._topics) >= MAX_TOPICS:
            return
        if fields.text() != 'cdr':
            raise ReaderError(f'topic {name} is not in CDR')
        msgtype, definition = self._schemas[schema]
        profiles = _profiles(fields.texts().get('offered_qos_profiles', ''))
        self._topics[number] = FoundTopic(name, msgtype, definition, profiles)
        yield self._topics[number]


def _from_sqlite(path: Path, folder: Path, remark: Remark) -> Iterator[Found]:
    with TemporaryDirectory(dir=folder, prefix='.salvage_') as name:
        # Opening it brings in what was written ahead, and that must not change the original.
        copy = folder / name / path.name
        shutil.copyfile(path, copy)
        _drop_part_of_a_page(copy)
        log = path.with_name(f'{path.name}-wal')
        if log.is_file():
            shutil.copyfile(log, copy.with_name(log.name))
        try:
            with closing(sqlite3.connect(copy)) as database:
                # Without this a file shorter than it says is refused as a whole.
                database.execute('PRAGMA writable_schema=ON')
                yield from _from_tables(database, copy)
        except (sqlite3.Error, ReaderError, ValueError, LookupError, TypeError) as error:
            remark(f'{path.name}: cut off or damaged: {error}')


def _drop_part_of_a_page(path: Path) -> None:
    """Cut an incomplete page off: SQLite reads its missing bytes as zeros."""
    with path.open('rb') as file:
        # Number of bytes in a page; 1 stands for the largest.
        size = int.from_bytes(file.read(18)[16:], 'big')
    size = 1 << 16 if size == 1 else size
    if size:
        os.truncate(path, path.stat().st_size // size * size)


def _from_tables(database: sqlite3.Connection, path: Path) -> Iterator[Found]:
    with suppress(sqlite3.DatabaseError):
        # A damaged page ends the counting of messages, and the reading of them just as well.
        check_tables(database, path)
    definitions: dict[str, MessageDefinition | None] = {}
    query = 'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
    with suppress(sqlite3.DatabaseError):
        for msgtype, encoding, text in database.execute(query):
            definitions[msgtype] = _definition(encoding, text)
    topics: dict[int, FoundTopic] = {}
    query = 'SELECT id, name, type, offered_qos_profiles FROM topics LIMIT ?'
    for number, name, msgtype, profiles in database.execute(query, (MAX_TOPICS,)):
        topics[number] = FoundTopic(
            str(name), str(msgtype), definitions.get(msgtype), _profiles(profiles)
        )
        yield topics[number]
    for number, stamp, raw in database.execute('SELECT topic_id, timestamp, data FROM messages'):
        if number in topics and isinstance(stamp, int) and isinstance(raw, bytes):
            yield topics[number], stamp, raw


def _definition(encoding: str, text: str) -> MessageDefinition | None:
    kind = _FORMATS.get(encoding)
    return MessageDefinition(kind, text) if kind and text else None


def _profiles(text: str) -> tuple[Qos, ...]:
    """Read QoS profiles; those that are damaged are no reason to lose the messages."""
    try:
        check_yaml(text)
        return tuple(parse_qos(text))
    except (ReaderError, ValueError, LookupError, TypeError, AttributeError):
        return ()
