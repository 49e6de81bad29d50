"""Checks of untrusted sqlite3 files: only tables of bounded size, before rosbags reads them.

A database can contain programs (views, triggers, computed columns), which would be run.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from typing import TYPE_CHECKING

from rosbags.rosbag2 import ReaderError

from cmpsp_ros.bags.storage.limits import MAX_CHUNK, MAX_METADATA, MAX_TOPICS, check_yaml

if TYPE_CHECKING:
    from pathlib import Path

_TABLES = ('schema', 'metadata', 'topics', 'message_definitions', 'messages')
_WORK_UNIT = 10_000
"""Steps of SQLite's machine between two looks at how many there were."""

_FREE_UNITS, _BYTES_A_UNIT = 1_000, 1_000


def check_sqlite(path: Path) -> None:
    """Make sure that a file can be read in bounded memory and time.

    Raises:
        ReaderError: Not a database, not closed, damaged, or with objects that no bag has.
    """
    log = path.with_name(f'{path.name}-wal')
    if log.exists() and log.stat().st_size:
        msg = f'{path.name} has not been closed; `cmpsp recover` makes a whole bag of it'
        raise ReaderError(msg)
    try:
        address = f'{path.absolute().as_uri()}?immutable=1'
        with closing(sqlite3.connect(address, uri=True)) as database:
            check_tables(database, path)
            # By the table itself, with its values no longer than `guard` lets them be.
            database.execute('SELECT max(length(data)) FROM messages').fetchone()
    except sqlite3.Error as error:
        raise ReaderError(f'{path.name} is not a sound database: {error}') from error


def guard(database: sqlite3.Connection, path: Path) -> None:
    """Let no value of a database grow beyond `MAX_CHUNK`, and no query go on without end.

    Pages of a damaged database can refer to each other in circles.
    """
    left = _FREE_UNITS + path.stat().st_size // _BYTES_A_UNIT

    def count() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_CHUNK)
    database.set_progress_handler(count, _WORK_UNIT)


def check_tables(database: sqlite3.Connection, path: Path) -> None:
    """Make sure that reading a database's tables runs no code in it.

    Raises:
        ReaderError: There is a view, trigger, virtual table or computed column, or too much.
        sqlite3.Error: Not a database, damaged, or with circular references.
    """
    guard(database, path)
    for kind, name, text in database.execute('SELECT type, name, sql FROM sqlite_master LIMIT 100'):
        virtual = 'VIRTUAL' in (text or '').upper().split()[:2]
        if kind not in {'table', 'index'} or virtual:
            msg = f'{path.name} has a {"virtual " * virtual}{kind} {name!r}, wanted plain tables'
            raise ReaderError(msg)
        if kind == 'index' and '(' in (text or '').partition('(')[2]:
            raise ReaderError(f'{path.name} has a computed index {name!r}, wanted plain tables')
    for table in _TABLES:
        # The last column says of each whether it is computed.
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
        if number >= MAX_TOPICS or size > MAX_METADATA:
            msg = f'more than {MAX_TOPICS} topics or {MAX_METADATA} bytes of QoS profiles'
            raise ReaderError(msg)
        check_yaml(str(profiles))
