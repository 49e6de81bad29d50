"""Keeps the machine code of kernels from one process to the next: one file for each signature.

A file is named by a digest of all that its machine code depends on, so it is never out of date.
One process compiles a kernel; others that want it wait, and load its file.
"""

from __future__ import annotations

import fcntl
import hashlib
import os
import re
import tempfile
import time
from pathlib import Path
from typing import IO, Any, Final

from numba.core import event

from cmpsp_ros.mpsp.jit import internals
from cmpsp_ros.mpsp.jit.fingerprint import VERSIONS, describe_type, fingerprint

WAITING: Final = 'cmpsp_ros:wait'
"""Kind of numba's event while another process compiles what is wanted."""

_PATIENCE: Final = 300.0
_POLL: Final = 0.05
_DAY: Final = 86_400.0
_CHECKSUM: Final = 16

_held: dict[Path, IO[bytes]] = {}


class KernelCache:
    """What numba asks for the machine code of one kernel; it has the methods of numba's own.

    Args:
        dispatcher: The kernel, as numba knows it.
        folder: Where files are kept; None to keep none.
    """

    def __init__(self, dispatcher: Any, folder: Path | None) -> None:
        self._dispatcher, self._folder = dispatcher, folder
        self._compiling: dict[Any, Path] = {}

    @property
    def cache_path(self) -> str:
        """The folder, for numba's statistics."""
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code for a signature; None if it has to be compiled, by this process then."""
        path = self._path(sig, target_context)
        if path is None:
            return None
        if (found := _load(path, sig, target_context)) is None:
            is_mine = _acquire(path, self._dispatcher)
            if is_mine and (found := _load(path, sig, target_context)) is not None:
                _release(path)
        if found is None:
            self._compiling[sig] = path
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code for a signature, if that can be done."""
        path = self._compiling.pop(sig, None)
        if path is None:
            return
        try:
            if (content := internals.dump(data)) is not None:
                _save(path, content)
        except OSError:  # the disk is full, or the folder has gone
            pass
        finally:
            _release(path)

    def give_up(self, sig: Any) -> None:
        """Let others compile it: here that has failed."""
        if (path := self._compiling.pop(sig, None)) is not None:
            _release(path)

    def enable(self) -> None:
        """Numba asks for it; there is nothing to do."""

    disable = flush = enable

    def _path(self, arguments: Any, target_context: Any) -> Path | None:
        if self._folder is None:
            return None
        function = self._dispatcher.py_func
        try:
            parts = [fingerprint(self._dispatcher), *map(describe_type, arguments)]
        except TypeError:  # no two processes could agree on what it is made of
            return None
        name = f'{function.__module__}.{function.__qualname__}'
        parts += [name, VERSIONS, *map(str, internals.target_description(target_context))]
        digest = hashlib.sha256('\0'.join(parts).encode()).hexdigest()
        name = re.sub(r'[^\w.]+', '-', name)[-150:]
        return self._folder / f'{name}.{digest[:32]}.kernel'


class _Failures(event.Listener):  # type: ignore[misc]  # numba has no types
    def on_start(self, event: Any) -> None:
        """Nothing to do."""

    def on_end(self, event: Any) -> None:
        cache = internals.cache_of(event.data['dispatcher'])
        if isinstance(cache, KernelCache) and internals.has_failed(event):
            cache.give_up(event.data['args'])


event.register('numba:compile', _Failures())


def _load(path: Path, arguments: Any, target_context: Any) -> Any:
    try:
        content = path.read_bytes()
        if _checksum(content[_CHECKSUM:]) != content[:_CHECKSUM]:  # cut short by a loss of power
            return None
        classes = internals.named_tuples(arguments)
        found = internals.load(content[_CHECKSUM:], classes, target_context)
        if time.time() - path.stat().st_mtime > _DAY:
            os.utime(path)
    except Exception:  # a file that cannot be used must not keep a robot from starting
        return None
    return found if tuple(found.signature.args) == tuple(arguments) else None


def _save(path: Path, content: bytes) -> None:
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        unfinished = Path(file.name)
        try:
            file.write(_checksum(content) + content)
            file.flush()
            unfinished.replace(path)
        except OSError:
            unfinished.unlink()
            raise


def _checksum(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_CHECKSUM).digest()


def _acquire(path: Path, dispatcher: Any) -> bool:
    """Become the one who compiles what ``path`` is for; False if that is not to be found out."""
    lock = path.with_suffix('.lock')
    if path in _held:
        return False
    try:
        if not _try(path, lock):
            with event.trigger_event(WAITING, {'dispatcher': dispatcher}):
                until = time.monotonic() + _PATIENCE
                while not _try(path, lock):
                    if time.monotonic() > until:
                        return False
                    time.sleep(_POLL)
    except OSError:
        return False
    return True


def _try(path: Path, lock: Path) -> bool:
    file = lock.open('ab')
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        # The process that had it before has removed the file: it then locks nothing.
        if os.fstat(file.fileno()).st_ino == lock.stat().st_ino:
            _held[path] = file
            return True
    except (BlockingIOError, FileNotFoundError):
        pass
    finally:
        if path not in _held:
            file.close()
    return False


def _release(path: Path) -> None:
    if (file := _held.pop(path, None)) is not None:
        path.with_suffix('.lock').unlink(missing_ok=True)
        file.close()
