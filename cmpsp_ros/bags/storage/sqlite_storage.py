"""Sqlite3 storage whose messages survive the end of its process, and a loss of power.

rosbags' writer does the format, but keeps everything in one transaction until it is closed.
"""

from __future__ import annotations

import sqlite3
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rosbags.rosbag2.storage_sqlite3 import Sqlite3Writer

from cmpsp_ros.bags.storage.form import NO_MESSAGE_YET

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rosbags.interfaces import Connection

_ROW_SIZE = 32
"""What a message takes beside its data, with its place in the index [bytes]."""


class SqliteStorage(Sqlite3Writer):
    """A database with a write-ahead log, as in rosbag2, merged when it is closed.

    Raises:
        OSError: It cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channel_stats: dict[int, int] = {}
        self.message_start_time = NO_MESSAGE_YET
        self.message_end_time = 0
        self._size = 0
        self._refused = False
        with _refusals():
            self.conn = sqlite3.connect(path)
            self.conn.execute('PRAGMA journal_mode=WAL')
            # In this mode every commit is on the disk when it returns.
            self.conn.execute('PRAGMA synchronous=FULL')
            self.conn.executescript(self.SQLITE_SCHEMA)
            self.cursor = self.conn.cursor()
        self._keep()

    @property
    def size(self) -> int:
        """Size of the file so far, about [bytes]."""
        return self._size

    def add_msgtype(self, connection: Connection) -> None:
        """Keep the definition of a topic's type."""
        with _refusals():
            super().add_msgtype(connection)

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Add a topic, with its publishers' QoS profiles as YAML."""
        with _refusals():
            super().add_connection(connection, offered_qos_profiles)
        self.channel_stats[connection.id] = 0

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        """Write one message."""
        with self._remembered_refusals():
            super().write(connection, timestamp, data)
        self.channel_stats[connection.id] += 1
        self.message_start_time = min(timestamp, self.message_start_time)
        self.message_end_time = max(timestamp, self.message_end_time)
        self._size += len(data) + _ROW_SIZE

    def flush(self) -> None:
        """Have everything written so far survive a loss of power."""
        with self._remembered_refusals():
            self.conn.commit()
        self._keep()

    def make_room(self, metadata_size: int) -> None:  # noqa: ARG002 (what SQLite frees is enough)
        """Drop everything not flushed."""
        with _refusals():
            self.conn.rollback()
        self._refused = False
        self.channel_stats = dict(self._kept[0])
        self.message_start_time, self.message_end_time = self._kept[1:]

    def close(self, version: int, metadata: str) -> None:
        """Write the bag's metadata, bring all into one file, and close it."""
        if self._refused:
            # SQLite may have taken back by itself all that came since the last flush.
            raise OSError('messages were refused')
        self.flush()
        with _refusals():
            # A second attempt writes over what the first one did.
            self.conn.execute(
                'INSERT OR REPLACE INTO metadata VALUES (1, ?, ?)', (version, metadata)
            )
            self.conn.commit()
            self.conn.execute('PRAGMA journal_mode=DELETE')
            self.conn.close()

    def abort(self) -> None:
        """Close the file without writing."""
        with _refusals():
            super().abort()

    @contextmanager
    def _remembered_refusals(self) -> Iterator[None]:
        try:
            with _refusals():
                yield
        except OSError:
            self._refused = True
            raise

    def _keep(self) -> None:
        stats = dict(self.channel_stats)
        self._kept = stats, self.message_start_time, self.message_end_time


@contextmanager
def _refusals() -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise OSError(str(error)) from error
