"""Keeps the machine code of kernels from one process to the next."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.runtime import rtsys

from cmpsp_ros.mpsp.jit.files import KernelFiles
from cmpsp_ros.mpsp.jit.folder import PACKAGE, kernel_folder
from cmpsp_ros.mpsp.jit.library import rebuild

_implementations: dict[type, set[str]] = {}


class _Place(_CacheLocator):  # type: ignore[misc]  # numba has no types
    """Where the machine code of the functions of one file is kept.

    For a file of this package it depends on its path in the package alone, and the folder's name
    stands for what is in it. A file of anybody else's goes by where it is and what it holds.
    """

    def __init__(self, path: str, stamp: str, line: int) -> None:
        self._path, self._stamp, self._line = path, stamp, line

    @classmethod
    def from_function(cls, function: Callable[..., Any], file: str) -> _Place | None:
        """The place of a function's machine code; None where there is no folder or no file."""
        folder, path = kernel_folder(), Path(file).absolute()
        if folder is None or not path.is_file():
            return None
        if path.is_relative_to(PACKAGE):
            inside, stamp = path.relative_to(PACKAGE).parent.as_posix().replace('/', '.'), ''
        else:
            inside = f'{path.stem}-{hashlib.sha256(bytes(path)).hexdigest()[:16]}'
            stamp = _digest_of(str(path))
        return cls(str(folder / inside), stamp, function.__code__.co_firstlineno)

    def get_cache_path(self) -> str:
        """The folder of the files."""
        return self._path

    def get_source_stamp(self) -> str:
        """What has to be the same for the files to be used."""
        return self._stamp

    def get_disambiguator(self) -> str:
        """Tells functions of one name apart."""
        return str(self._line)


class _Files(CompileResultCacheImpl):  # type: ignore[misc]  # numba has no types
    _locator_classes = (_Place,)

    def rebuild(self, target_context: Any, payload: tuple[Any, ...]) -> Any:
        """What numba makes of a kernel, from what is kept of it."""
        return rebuild(target_context, payload)


class KernelCache(FunctionCache):  # type: ignore[misc]  # numba has no types
    """Numba's cache of one kernel, which knows its implementations and forgives a bad disk."""

    _impl_class = _Files

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        locator = self._impl.locator
        self._cache_file = KernelFiles(
            Path(locator.get_cache_path()), self._impl.filename_base, locator.get_source_stamp()
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature, or None.

        Numba's own would first load all that it compiles with, which takes longer than the rest.
        """
        try:
            rtsys.initialize(target_context)
            return self._load_overload(sig, target_context)
        except Exception:
            # A file cut short, as by a loss of power, must not keep a robot from starting.
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, if that can be done."""
        try:
            super().save_overload(sig, data)
        except OSError:
            self.disable()

    def _index_key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        return (*super()._index_key(sig, codegen), *sorted(_sources_behind(sig)))


def enable_cache(dispatcher: Any, function: Callable[..., Any]) -> None:
    """Have numba's dispatcher of ``function`` load from the cache, if there can be one."""
    try:
        dispatcher._cache = KernelCache(function)  # noqa: SLF001 (enable_caching has no choice)
    except (RuntimeError, OSError):
        # No folder can be had, or its source is in no file.
        return


def note_implementation(data_class: type, function: Callable[..., Any]) -> None:
    """Make the file of ``function`` part of the key of whatever is compiled for ``data_class``."""
    source = _digest_of(function.__code__.co_filename)
    _implementations.setdefault(data_class, set()).add(source)


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
