"""The folder of the machine code made from these sources, and what the sources are.

Numba by itself notices only a change of the file in which a cached function stands: not of the
kernels that it calls, nor of the constants that it imports from elsewhere. Here the folder's name
is a digest of all these sources, so that changed code never meets machine code of before, and the
same code meets it wherever it was installed.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import sys
import tempfile
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Final

import numba

PACKAGE: Final = Path(__file__).parents[2]
"""Folder of this package."""

_NAME: Final = PACKAGE.name
_MARK: Final = f'{_NAME}.mpsp.jit.compiled import'.encode()
_IMPORT: Final = re.compile(rb'\b%b((?:\.\w+)+)(?: import (\([^)]*\)|[^\n(]*))?' % _NAME.encode())


@cache
def kernel_folder() -> Path | None:
    """Folder of the machine code made from these sources, or None where there can be none.

    It is in ``$NUMBA_CACHE_DIR``, ``$XDG_CACHE_HOME`` or ``~/.cache``; where none of them can be
    used, below the folder for temporary files.
    """
    try:
        name = f'kernels-{_key()}'
    except OSError:
        return None
    usable = (each / name for each in _candidates() if _is_ours(each) and _is_ours(each / name))
    return next(usable, None)


def wanted_place() -> Path:
    """Where the folder should be, if it can be made there."""
    return next(_candidates())


def old_folders() -> list[Path]:
    """Folders of the machine code of other versions, beside the one in use."""
    folder = kernel_folder()
    if folder is None:
        return []
    return sorted(each for each in folder.parent.glob('kernels-*') if each != folder)


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
    """Whether a folder, made if need be, can be written to by this user and by nobody else.

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


def _key() -> str:
    digest = hashlib.sha256(f'{numba.__version__} {sys.version}'.encode())
    for name, source in sorted(kernel_sources().items()):
        digest.update(f'\0{name}\0{len(source)}\0'.encode() + source)
    return digest.hexdigest()[:16]


def kernel_sources() -> dict[str, bytes]:
    """Sources, by path in the package, of all modules with kernels and of what they import."""
    every = {
        path.relative_to(PACKAGE).as_posix(): path.read_bytes() for path in PACKAGE.rglob('*.py')
    }
    waiting = [name for name, source in every.items() if _MARK in source]
    found: dict[str, bytes] = {}
    while waiting:
        name = waiting.pop()
        if name not in found:
            found[name] = every[name]
            waiting += _imported(every[name], every)
    return found


def _imported(source: bytes, every: Mapping[str, bytes]) -> Iterator[str]:
    for module, names in _IMPORT.findall(source):
        path = module.decode().strip('.').replace('.', '/')
        inside = [f'{path}/{each}' for each in re.findall(r'\w+', names.decode())]
        for each in (path, *inside):
            yield from (file for file in (f'{each}.py', f'{each}/__init__.py') if file in every)
