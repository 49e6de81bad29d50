"""The folder of a bag: its files beside the messages, and the writer's lock."""

from __future__ import annotations

import fcntl
import os
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

METADATA = 'metadata.yaml'
"""What a whole bag says about itself."""

UNFINISHED = 'unfinished.json'
"""What will be the custom data of a bag that is being written."""


class FolderLock:
    """The writer's lock, released by `release` or by the end of the process."""

    def __init__(self, folder: Path) -> None:
        self._file = os.open(folder, os.O_RDONLY)
        # Some network file systems know no locks: the bag is good all the same.
        with suppress(OSError):
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)

    def sync(self) -> None:
        """Have the names of the files in the folder survive a loss of power.

        Raises:
            OSError: The disk refuses.
        """
        os.fsync(self._file)

    def release(self) -> None:
        """Let go."""
        os.close(self._file)


def is_locked(folder: Path) -> bool:
    """Whether somebody holds the lock of a folder."""
    with _opened(folder) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        except OSError:
            return False
        return False


def write_whole(path: Path, text: str) -> None:
    """Write a file atomically: it is complete or not there.

    Raises:
        OSError: The disk refuses.
    """
    draft = path.with_name(f'{path.name}.tmp')
    with draft.open('w', encoding='utf-8') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    file = os.open(folder, os.O_RDONLY)
    try:
        yield file
    finally:
        os.close(file)
