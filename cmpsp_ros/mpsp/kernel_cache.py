"""Where compiled kernels are kept between two runs, and when they may be used again.

Numba by itself notices only a change of the file in which a cached function stands: not of the
kernels that it calls, nor of the constants that it imports from elsewhere. Here the folder's name
is a digest of all these sources, so that changed code never meets machine code of before.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Final

import numba
from numba.core.caching import FunctionCache

_PACKAGE: Final = Path(__file__).parents[1]
_NAME: Final = _PACKAGE.name
_MARK: Final = f'{_NAME}.mpsp.compiled import'.encode()
_IMPORT: Final = re.compile(rb'\b%b((?:\.\w+)+)(?: import (\([^)]*\)|[^\n(]*))?' % _NAME.encode())

_implementations: dict[type, set[str]] = {}


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba has no types
    """Numba's cache of one kernel, which knows its implementations and forgives a bad disk."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:
            # A file cut short, as by a loss of power, must not keep a robot from starting.
            self._without_failing(self.flush)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, if that can be done."""
        self._without_failing(lambda: super(KernelCache, self).save_overload(sig, data))

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return (*super()._index_key(sig, codegen), *sorted(_sources_behind(sig)))

    def _without_failing(self, write: Callable[[], None]) -> None:
        try:
            write()
        except OSError:
            self.disable()


def enable_cache(dispatcher: Any, function: Callable[..., Any]) -> None:
    """Have numba's dispatcher of ``function`` load from the cache, if there can be one."""
    folder = kernel_folder()
    if folder is None:
        return
    try:
        with _numba_caches_in(folder):
            dispatcher._cache = KernelCache(function)  # noqa: SLF001 (enable_caching has no choice)
    except RuntimeError:
        # Its source is in no file.
        return


def note_implementation(data_class: type, function: Callable[..., Any]) -> None:
    """Make the file of ``function`` part of the key of whatever is compiled for ``data_class``."""
    source = _digest_of(function.__code__.co_filename)
    _implementations.setdefault(data_class, set()).add(source)


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


@contextmanager
def _numba_caches_in(folder: Path) -> Iterator[None]:
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(folder)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def _key() -> str:
    digest = hashlib.sha256(f'{numba.__version__} {sys.version}'.encode())
    for name, source in sorted(kernel_sources().items()):
        digest.update(f'\0{name}\0{len(source)}\0'.encode() + source)
    return digest.hexdigest()[:16]


def kernel_sources() -> dict[str, bytes]:
    """Sources, by path in the package, of all modules with kernels and of what they import."""
    every = {
        path.relative_to(_PACKAGE).as_posix(): path.read_bytes() for path in _PACKAGE.rglob('*.py')
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


def _sources_behind(sig: Any) -> set[str]:
    """Digests of the files that implement something for the named tuples of a signature."""
    found: set[str] = set()
    for each in sig:
        if isinstance(each, numba.types.BaseNamedTuple):
            found |= _implementations.get(each.instance_class, set())
        if isinstance(each, numba.types.BaseTuple):
            found |= _sources_behind(each.types)
    return found


@cache
def _digest_of(filename: str) -> str:
    try:
        return hashlib.sha256(Path(filename).read_bytes()).hexdigest()
    except OSError:
        return filename
