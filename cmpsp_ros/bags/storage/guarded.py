"""Bags of anybody's making: rosbags' reader behind bounds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import yaml
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.rosbag2.reader import DirectoryReader

from cmpsp_ros.bags.storage.folder import METADATA
from cmpsp_ros.bags.storage.guarded_mcap import GuardedMcap
from cmpsp_ros.bags.storage.guarded_sqlite import GuardedSqlite
from cmpsp_ros.bags.storage.limits import (
    MAX_CHUNK,
    MAX_FILES,
    MAX_METADATA,
    MAX_TOPICS,
    check_file,
    check_inflated_file,
    check_yaml,
    inflate,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Generator, Mapping
    from pathlib import Path
    from typing import Any

    from rosbags.interfaces import Connection
    from rosbags.rosbag2.reader import ReaderProtocol

INFORMATION = 'rosbag2_bagfile_information'


def read_metadata(folder: Path) -> dict[str, Any]:
    """Read what a bag's folder says about it.

    Raises:
        ReaderError: Too large, not YAML, or not a bag's.

    """
    path = folder / METADATA
    check_file(path, MAX_METADATA)
    text = path.read_text(encoding='utf-8')
    check_yaml(text)
    try:
        document = yaml.load(text, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError) as error:
        msg = f'{METADATA} is damaged: {" ".join(str(error).split())}'
        raise ReaderError(msg) from error
    information = document.get(INFORMATION) if isinstance(document, dict) else None
    if not isinstance(information, dict):
        msg = f'{METADATA} has no {INFORMATION}'
        raise ReaderError(msg)
    return information


class _GuardedFolder(DirectoryReader):
    """Folder with metadata, its storage files read by the guarded readers."""

    path: Path

    STORAGE_PLUGINS: Mapping[str, type[ReaderProtocol]] = {
        'mcap': GuardedMcap,
        'sqlite3': GuardedSqlite,
    }

    def open(self) -> None:
        """Read metadata and storage files' indices.

        Raises:
            ReaderError: Damaged, or beyond what is read.

        """
        information = read_metadata(self.path)
        paths = information.get('relative_file_paths')
        if not isinstance(paths, list) or not 0 < len(paths) <= MAX_FILES:
            msg = f'{METADATA} names no files, or more than {MAX_FILES}'
            raise ReaderError(msg)
        names = [str(each).rpartition('/')[2] for each in paths]
        if len(set(names)) < len(names):
            msg = f'{METADATA} names a file twice'
            raise ReaderError(msg)
        for name in names:
            if not (self.path / name).exists():
                msg = f'{METADATA} names {name}, which is not there'
                raise ReaderError(msg)
            check_file(self.path / name)
            if str(information.get('compression_mode')).lower() == 'file':
                check_inflated_file(self.path / name)
        super().open()
        # The base would uncompress each message itself, however large it becomes.
        self._compressed = self.metadata.compression_mode == 'message'
        self.metadata = self.metadata._replace(compression_mode=None)
        if len(self.connections) > MAX_TOPICS:
            count = len(self.connections)
            self.close()
            msg = f'{count} topics, at most {MAX_TOPICS} are read'
            raise ReaderError(msg)

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Iterate over messages, file by file, within each in order of time."""
        for connection, stamp, raw in super().messages(connections, start, stop):
            whole = inflate(raw, 'zstd', MAX_CHUNK) if self._compressed else raw
            yield connection, stamp, whole


class GuardedReader(Reader):
    """rosbags' reader of a folder or a single storage file, behind bounds."""

    STORAGE_PLUGINS: Mapping[str, type[ReaderProtocol]] = {
        'dir': _GuardedFolder,
        '.mcap': GuardedMcap,
        '.db3': GuardedSqlite,
    }
