"""Notices when numba compiles, so that whoever waits for it can be told."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from numba.core.event import Listener, install_listener

_PACKAGE = f'{__name__.partition(".")[0]}.'


class _Watch(Listener):  # type: ignore[misc]  # numba has no types
    def __init__(self, begin: Callable[[], None]) -> None:
        self.names: list[str] = []
        self._begin = begin

    def on_start(self, event: Any) -> None:
        function = event.data['dispatcher'].py_func
        # Numba compiles its own functions under way, and tells of them as well.
        if not function.__module__.startswith(_PACKAGE):
            return
        if not self.names:
            self._begin()
        self.names.append(function.__qualname__)

    def on_end(self, event: Any) -> None:
        """Nothing to do: who waits knows when it is over."""


@contextmanager
def compilations(begin: Callable[[], None] = lambda: None) -> Iterator[list[str]]:
    """The kernels of this package that are compiled within; those that the cache has are not.

    Args:
        begin: Called before the first of them is compiled.
    """
    watch = _Watch(begin)
    with install_listener('numba:compile', watch):
        yield watch.names
