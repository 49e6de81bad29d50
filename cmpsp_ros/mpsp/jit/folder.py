"""The folder of machine code: one for all versions, whose files are named by what they hold."""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Final

_NAME: Final = __name__.partition('.')[0]
MAX_AGE: Final = 30 * 86_400.0
"""How long a file may go unused before it can be removed [s]."""
MAX_SIZE: Final = 500_000_000
"""Size up to which nothing is removed [bytes]."""


@cache
def kernel_folder() -> Path | None:
    """Folder of the machine code, or None where there can be none.

    It is in ``$NUMBA_CACHE_DIR``, ``$XDG_CACHE_HOME`` or ``~/.cache``, else below the folder for
    temporary files.
    """
    folders = (each / 'kernels' for each in _candidates())
    return next((each for each in folders if _is_ours(each.parent) and _is_ours(each)), None)


def wanted_place() -> Path:
    """The folder that the user's settings ask for."""
    return next(_candidates())


def prune(
    folder: Path, now: float, max_age: float = MAX_AGE, max_size: int = MAX_SIZE
) -> list[Path]:
    """Remove what was not used for `max_age` [s], oldest first, while a folder exceeds `max_size`.

    `now` is the time since the epoch [s]; files in folders below count as well. Returns the files
    that are gone.
    """
    files = []
    for each in folder.rglob('*'):
        try:
            found = each.lstat()
        except OSError:  # another process has removed it
            continue
        if stat.S_ISREG(found.st_mode):
            files.append((found.st_mtime, found.st_size, each))
    size, removed = sum(each[1] for each in files), []
    for used, length, path in sorted(files):
        if size <= max_size or now - used <= max_age:
            break
        path.unlink(missing_ok=True)
        size -= length
        removed.append(path)
    return removed


def _candidates() -> Iterator[Path]:
    given = os.environ.get('NUMBA_CACHE_DIR')
    if given:
        yield Path(given).absolute() / _NAME
    else:
        cache_home = os.environ.get('XDG_CACHE_HOME', '')
        try:
            # The standard has relative paths ignored.
            home = Path(cache_home) if cache_home.startswith('/') else Path.home() / '.cache'
            yield home / _NAME
        except RuntimeError:
            pass
    yield Path(tempfile.gettempdir()) / f'{_NAME}-{os.getuid()}'


def _is_ours(folder: Path) -> bool:
    """True for a folder, made if need be, that this user and nobody else can write to.

    Loading machine code is running it: a folder that others may write to is no place for it.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        private = found.st_uid == os.getuid() and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if not stat.S_ISDIR(found.st_mode) or not private:
            return False
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True
