"""Sqlite3 files: checks before rosbags reads them, recovery of messages, and crash-safe writing.

rosbags trusts a database, which can contain programs (views, triggers, computed columns) that would
be run; its writer does the format, but keeps everything in one transaction until it is closed.
"""

import os
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from tempfile import TemporaryDirectory

from rosbags.interfaces import Connection, MessageDefinition
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from cmpsp_ros.bags.storage import common, limits

_TABLES = ('schema', 'metadata', 'topics', 'message_definitions', 'messages')

_WORK_UNIT = 10_000  # steps of SQLite's machine between two checks of how many there were
_FREE_UNITS, _BYTES_PER_UNIT = 1_000, 1_000

_ROW_SIZE = 32  # size of a message's row beside its data, with its place in the index [bytes]


def check_sqlite(path: Path) -> None:
    """Check that rosbags can read a file in bounded memory and time, and runs no code in it."""
    log = path.with_name(f'{path.name}-wal')
    if log.exists() and log.stat().st_size:
        msg = f'{path.name} has not been closed; `cmpsp recover` makes a whole bag of it'
        raise ReaderError(msg)
    try:
        address = f'{path.absolute().as_uri()}?immutable=1'
        with closing(sqlite3.connect(address, uri=True)) as database:
            _check_tables(database, path)
            # SQLite knows it without reading the values, so that no limit would stop it.
            longest = database.execute('SELECT max(length(data)) FROM messages').fetchone()[0] or 0
            if longest > limits.MAX_CHUNK:
                most = f'at most {limits.MAX_CHUNK} are read'
                raise ReaderError(f'message of {longest} bytes in {path.name}, {most}')
    except sqlite3.Error as error:
        raise ReaderError(f'{path.name} is not a sound database: {error}') from error


def _guard(database: sqlite3.Connection, path: Path) -> None:
    """Bound values, and the work of a query: damaged pages can refer to each other in circles."""
    left = _FREE_UNITS + path.stat().st_size // _BYTES_PER_UNIT

    def is_over() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, limits.MAX_CHUNK)
    database.set_progress_handler(is_over, _WORK_UNIT)


def _check_tables(database: sqlite3.Connection, path: Path) -> None:
    """Check that a database has plain tables only; raises `ReaderError` or `sqlite3.Error`."""
    _guard(database, path)
    for kind, name, text in database.execute('SELECT type, name, sql FROM sqlite_master LIMIT 100'):
        statement = (text or '').upper()
        found = ''
        if kind not in {'table', 'index'} or 'VIRTUAL' in statement.split()[:2]:
            found = f'{"virtual " * (kind == "table")}{kind}'
        elif kind == 'index' and '(' in statement.partition('(')[2]:
            found = 'computed index'
        if found:
            raise ReaderError(f'{path.name} has a {found} {name!r}, wanted plain tables')
    for table in _TABLES:
        # The last column marks computed ones.
        if any(each[-1] for each in database.execute(f'PRAGMA table_xinfo({table})')):
            raise ReaderError(f'{path.name} has computed columns in {table}, wanted plain tables')
    database.execute('SELECT count(*), min(timestamp), max(timestamp) FROM messages').fetchone()
    columns = [each[1] for each in database.execute('PRAGMA table_xinfo(topics)')]
    if 'offered_qos_profiles' not in columns:
        return
    size = 0
    rows = database.execute('SELECT offered_qos_profiles FROM topics')
    for number, (profiles,) in enumerate(rows):
        size += len(str(profiles))
        if number >= limits.MAX_TOPICS or size > limits.MAX_METADATA:
            most = f'{limits.MAX_TOPICS} topics or {limits.MAX_METADATA} bytes'
            raise ReaderError(f'more than {most} of QoS profiles')
        limits.check_yaml(str(profiles))


def salvage_sqlite(path: Path, folder: Path, remark: common.Remark) -> Iterator[common.Found]:
    """Topics and messages of a file that may be cut off, not closed, or damaged."""
    with TemporaryDirectory(dir=folder, prefix='.salvage_') as name:
        # Opening it merges its write-ahead log, and that must not change the original.
        copy = folder / name / path.name
        shutil.copyfile(path, copy)
        _drop_incomplete_page(copy)
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


def _drop_incomplete_page(path: Path) -> None:
    """Cut an incomplete page off: SQLite reads its missing bytes as zeros."""
    with path.open('rb') as file:
        # Number of bytes in a page; 1 stands for the largest.
        size = int.from_bytes(file.read(18)[16:], 'big')
    size = 1 << 16 if size == 1 else size
    if size:
        os.truncate(path, path.stat().st_size // size * size)


def _from_tables(database: sqlite3.Connection, path: Path) -> Iterator[common.Found]:
    definitions: dict[str, MessageDefinition | None] = {}
    with suppress(sqlite3.DatabaseError):
        # A damaged page ends the counting of messages, and the reading of them just as well.
        _check_tables(database, path)
    query = 'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
    with suppress(sqlite3.DatabaseError):
        for msgtype, encoding, text in database.execute(query):
            definitions[msgtype] = common.read_definition(encoding, text)
    topics: dict[int, common.FoundTopic] = {}
    query = 'SELECT id, name, type, offered_qos_profiles FROM topics LIMIT ?'
    for number, name, msgtype, profiles in database.execute(query, (limits.MAX_TOPICS,)):
        topics[number] = common.FoundTopic(
            str(name), str(msgtype), definitions.get(msgtype), common.read_profiles(profiles)
        )
        yield topics[number]
    for number, stamp, raw in database.execute('SELECT topic_id, timestamp, data FROM messages'):
        if number in topics and isinstance(stamp, int) and isinstance(raw, bytes):
            yield topics[number], stamp, raw


class SqliteStorage(Sqlite3Writer):
    """A new database with a write-ahead log, as in rosbag2, merged when it is closed."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channel_stats: dict[int, int] = {}
        self.message_start_time = common.NO_MESSAGE_YET
        self.message_end_time = 0
        self.size = 0  # approximate size of the file so far [bytes]
        self._refused = False
        self.conn = sqlite3.connect(path)
        self.conn.execute('PRAGMA journal_mode=WAL')
        # In this mode every commit is on the disk when it returns.
        self.conn.execute('PRAGMA synchronous=FULL')
        self.conn.executescript(self.SQLITE_SCHEMA)
        self.cursor = self.conn.cursor()
        self._keep()

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a topic, with its publishers' QoS profiles as YAML."""
        super().add_connection(connection, offered_qos_profiles)
        self.channel_stats[connection.id] = 0

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Write one message."""
        refused, self._refused = self._refused, True
        super().write(connection, timestamp, data)
        self._refused = refused
        self.channel_stats[connection.id] += 1
        self.message_start_time = min(timestamp, self.message_start_time)
        self.message_end_time = max(timestamp, self.message_end_time)
        self.size += len(data) + _ROW_SIZE

    def flush(self) -> None:
        """Make everything written so far survive a loss of power."""
        refused, self._refused = self._refused, True
        self.conn.commit()
        self._refused = refused
        self._keep()

    def make_room(self, metadata_size: int) -> None:  # noqa: ARG002 (what SQLite frees is enough)
        """Drop everything not flushed."""
        self.conn.rollback()
        self._refused = False
        self.channel_stats = dict(self._kept[0])
        self.message_start_time, self.message_end_time = self._kept[1:]

    def close(self, version: int, metadata: str) -> None:
        """Write the bag's metadata, merge the log into the file, and close it."""
        if self._refused:
            # SQLite may have taken back by itself all that came since the last flush.
            raise OSError('messages were refused')
        self.flush()
        # A second attempt overwrites the first one.
        self.conn.execute('INSERT OR REPLACE INTO metadata VALUES (1, ?, ?)', (version, metadata))
        self.conn.commit()
        self.conn.execute('PRAGMA journal_mode=DELETE')
        self.conn.close()

    def _keep(self) -> None:
        self._kept = dict(self.channel_stats), self.message_start_time, self.message_end_time
