"""Keeps the machine code of kernels from one process to the next: one file for each signature.

A file is named by a digest of all that its machine code depends on, so it is never out of date, and
one folder will do for all versions. One process compiles a kernel; others that want it wait, and
load its file.
"""

import fcntl
import hashlib
import os
import re
import stat
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from numba.core import event

from cmpsp_ros.mpsp.jit import internals
from cmpsp_ros.mpsp.jit.fingerprint import VERSIONS, describe_type, fingerprint

_NAME: Final = __name__.partition('.')[0]
MAX_AGE: Final = 30 * 86_400.0  # time that a file may go unused before it can be removed [s]
MAX_SIZE: Final = 500_000_000  # size up to which nothing is removed [bytes]


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
    """Remove files unused for `max_age` [s], and the oldest while a folder exceeds `max_size`.

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


# Kind of numba's event while another process compiles a kernel that is needed.
WAITING: Final = 'cmpsp_ros:wait'

# The source of this package: it decides how functions are called and what is in files.
_SOURCE: Final = b''.join(each.read_bytes() for each in sorted(Path(__file__).parent.glob('*.py')))
_FORMAT: Final = hashlib.sha256(_SOURCE).hexdigest()
_DAY: Final = 86_400.0
_CHECKSUM: Final = 16


class KernelCache:
    """Machine code of one kernel, with the methods that numba asks of its own cache.

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
        """Machine code for a signature; None if this process has to compile it."""
        path = self._path(sig, target_context)
        if path is None:
            return None
        if (found := _load(path, sig, target_context)) is None:
            _acquire(path, self._dispatcher)
            if (found := _load(path, sig, target_context)) is None:
                self._compiling[sig] = path
            else:
                _release(path)
        return found

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the part for a signature, if that can be done and other modules may call it.

        One that has no entry for Python is in the files of its callers.
        """
        path = self._compiling.pop(sig, None)
        if path is None:
            return
        is_inner = self._dispatcher.targetoptions.get('no_cpython_wrapper')
        try:
            if not is_inner and (content := internals.dump(data)) is not None:
                _save(path, content)
        except OSError:  # the disk is full, or the folder has gone
            pass
        finally:
            _release(path)

    def load_machine_code(self, sig: Any, kind: type) -> Any:
        """Part of this kind with machine code for a signature; None where no file has it."""
        context = self._dispatcher.targetctx
        path = self._path(sig, context, kind.__name__)
        return None if path is None else _load_machine_code(path, sig, context)

    def finish(self, sig: Any, part: Any, make: Callable[[Any], Any]) -> tuple[Any, Any]:
        """Have the machine code of a part made, unless a file has it.

        Args:
            sig: Its signature.
            part: Numba's result, with a `Part`.
            make: Called with the part, to return the machine code as numba's library.

        Returns:
            The part, or that of the file, in which names of functions may be others; and the
            library that was made, or None.
        """
        if part.library.machine_code is not None:
            return part, None
        path = self._path(sig, part.target_context, type(part.library).__name__)
        if path is None:
            return part, make(part)
        _acquire(path, self._dispatcher)
        try:
            found = _load_machine_code(path, sig, part.target_context)
            if found is not None:
                return found, None
            made = make(part)
            with suppress(OSError):  # the disk is full, or the folder has gone
                if (content := internals.dump(part)) is not None:
                    _save(path, content)
        finally:
            _release(path)
        return part, made

    def give_up(self, sig: Any) -> None:
        """Let others compile a signature after a failure."""
        if (path := self._compiling.pop(sig, None)) is not None:
            _release(path)

    def enable(self) -> None:
        """Do nothing: numba asks for it."""

    disable = flush = enable

    def _path(self, arguments: Any, target_context: Any, kind: str = 'Part') -> Path | None:
        if self._folder is None:
            return None
        function = self._dispatcher.py_func
        try:
            parts = [fingerprint(self._dispatcher), *map(describe_type, arguments)]
        except TypeError:  # no two processes could agree on what it is made of
            return None
        name = f'{function.__module__}.{function.__qualname__}'
        parts += [name, kind, _FORMAT, VERSIONS]
        parts += map(str, internals.target_description(target_context))
        digest = hashlib.sha256('\0'.join(parts).encode()).hexdigest()
        name = re.sub(r'[^\w.]+', '-', name)[-150:]
        return self._folder / f'{name}.{digest[:32]}.kernel'


class _Failures(event.Listener):  # type: ignore[misc]  # numba has no types
    def on_start(self, event: Any) -> None:
        """Do nothing."""

    def on_end(self, event: Any) -> None:
        kept = internals.cache_of(event.data['dispatcher'])
        if isinstance(kept, KernelCache) and internals.has_failed(event):
            kept.give_up(event.data['args'])


event.register('numba:compile', _Failures())


def _load(path: Path, arguments: Any, target_context: Any) -> Any:
    try:
        content = path.read_bytes()
        if not is_whole(content):  # cut short by a loss of power
            return None
        classes = internals.named_tuples(arguments)
        found = internals.load(content[_CHECKSUM:], classes, target_context)
        if time.time() - path.stat().st_mtime > _DAY:
            os.utime(path)
    except Exception:  # a file that cannot be used must not keep a robot from starting
        return None
    return found if tuple(found.signature.args) == tuple(arguments) else None


def _load_machine_code(path: Path, arguments: Any, target_context: Any) -> Any:
    found = _load(path, arguments, target_context)
    return None if found is None or found.library.machine_code is None else found


def is_whole(content: bytes) -> bool:
    """True where the content of a file is as it was written."""
    return _checksum(content[_CHECKSUM:]) == content[:_CHECKSUM]


def _save(path: Path, content: bytes) -> None:
    save_whole(path, _checksum(content) + content)


def save_whole(path: Path, content: bytes) -> None:
    """Write the content of a file, checksum and all, in one move."""
    with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
        unfinished = Path(file.name)
        try:
            file.write(content)
            file.flush()
            unfinished.replace(path)
        except OSError:
            unfinished.unlink()
            raise


def _checksum(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_CHECKSUM).digest()


@cache
def _locks(folder: Path) -> int:
    """File of which each kernel locks one byte; a process that ends unlocks all of its own."""
    return os.open(folder / '.lock', os.O_RDWR | os.O_CREAT, 0o600)


def _byte(path: Path) -> int:
    return int(path.stem.rpartition('.')[2][:15], 16)


def _acquire(path: Path, dispatcher: Any) -> None:
    """Become the one process that compiles a kernel, if that can be done."""
    with suppress(OSError):
        locks, place = _locks(path.parent), (1, _byte(path))
        try:
            fcntl.lockf(locks, fcntl.LOCK_EX | fcntl.LOCK_NB, *place)
        except BlockingIOError:
            with event.trigger_event(WAITING, {'dispatcher': dispatcher}):
                fcntl.lockf(locks, fcntl.LOCK_EX, *place)


def _release(path: Path) -> None:
    with suppress(OSError):
        fcntl.lockf(_locks(path.parent), fcntl.LOCK_UN, 1, _byte(path))
