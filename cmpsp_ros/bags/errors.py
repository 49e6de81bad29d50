"""Errors of this package."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


class BagError(Exception):
    """A bag cannot be read or written; the message names file, finding and requirement."""


class UnknownTypeError(BagError):
    """A topic cannot be recorded because nothing here defines its message type."""


@contextmanager
def written(path: Path) -> Iterator[None]:
    """Turn a refusal of the disk into a `BagError`."""
    try:
        yield
    except OSError as error:
        raise BagError(f'{path}: cannot be written: {error.strerror or error}') from error
