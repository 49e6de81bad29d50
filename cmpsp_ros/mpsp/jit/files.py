"""The files of one kernel's machine code: one for each signature.

Numba itself keeps one index for all signatures of a function. Processes that compile at once lose
entries of each other's there, and who cannot import the class of an argument in one entry can read
none of them. Files that know nothing of each other have neither trouble.
"""

from __future__ import annotations

import hashlib
import pickle
import tempfile
from pathlib import Path
from typing import Any

from numba.core.serialize import dumps


class KernelFiles:
    """Keeps what numba makes of a function, by signature and processor.

    Args:
        folder: Where; made when something is kept.
        name: What the files' names begin with.
        stamp: Stands for the function's source: what was kept with another one is not found.
    """

    def __init__(self, folder: Path, name: str, stamp: str) -> None:
        self._folder, self._name, self._stamp = folder, name, stamp

    def load(self, key: tuple[Any, ...]) -> Any:
        """What was saved under ``key``, or None.

        Raises:
            Exception: Of any kind, where a file is damaged.
        """
        try:
            file = self._path(key).open('rb')
        except OSError:
            return None
        with file:
            kept_for = pickle.load(file)  # noqa: S301 (the folder is this user's alone)
            return pickle.load(file) if kept_for == (self._stamp, key) else None  # noqa: S301

    def save(self, key: tuple[Any, ...], data: Any) -> None:
        """Keep ``data`` in place of what was kept before.

        Raises:
            OSError: It cannot be kept.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._path(key)
        with tempfile.NamedTemporaryFile(dir=self._folder, delete=False) as file:
            unfinished = Path(file.name)
            try:
                file.write(dumps((self._stamp, key)) + dumps(data))
                file.flush()
                unfinished.replace(path)
            except OSError:
                unfinished.unlink()
                raise

    def _path(self, key: tuple[Any, ...]) -> Path:
        signature, processor, *_ = key
        digest = hashlib.sha256(f'{signature} {processor}'.encode()).hexdigest()
        return self._folder / f'{self._name}.{digest[:16]}.kernel'
