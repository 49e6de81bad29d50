"""Names of kernels as they are compiled, and progress on a terminal or in a log."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from typing import Any, Final

from numba.core.event import Listener, install_listener

from cmpsp_ros.mpsp.jit.cache import WAITING, KernelCache
from cmpsp_ros.mpsp.jit.internals import cache_of

_LINE_PERIOD: Final = 5.0
_BAR: Final = 20


class _Watch(Listener):  # type: ignore[misc]  # numba has no types
    def __init__(self, begin: Callable[[str], None], wait: Callable[[str], None]) -> None:
        self.names: list[str] = []
        self._begin, self._wait, self._depth = begin, wait, 0

    def on_start(self, event: Any) -> None:
        name = _name(event)
        if event.kind == WAITING:
            self._wait(name or '')
        elif name is not None:
            self.names.append(name)
            self._depth += 1
            if self._depth == 1:
                self._begin(name)

    def on_end(self, event: Any) -> None:
        self._depth -= event.kind != WAITING and _name(event) is not None


def _name(event: Any) -> str | None:
    """The kernel's name; None for functions of numba, which it compiles under way."""
    dispatcher = event.data['dispatcher']
    is_ours = isinstance(cache_of(dispatcher), KernelCache)
    return str(dispatcher.py_func.__qualname__) if is_ours else None


@contextmanager
def compilations(
    begin: Callable[[str], None] = lambda _: None, wait: Callable[[str], None] = lambda _: None
) -> Iterator[list[str]]:
    """List the kernels compiled within; those loaded from files do not count.

    `begin` gets the name of a kernel before it is compiled, `wait` the name of one that another
    process is compiling.
    """
    watch = _Watch(begin, wait)
    with install_listener('numba:compile', watch), install_listener(WAITING, watch):
        yield watch.names


class ProgressLine:
    """Shows the kernel being compiled: in one line of a terminal, elsewhere by a line every 5 s.

    Args:
        expected: About how many kernels there are; None if that is not known.
        say: Called with each line; without, it goes to the standard error.
        clock: Seconds.
    """

    def __init__(
        self,
        expected: int | None = None,
        say: Callable[[str], object] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._expected, self._clock = expected, clock
        self._is_terminal = say is None and sys.stderr.isatty()
        self._say = say or (lambda text: _write(f'{text}\n'))
        self._next: float | None = None

    def show(self, count: int, what: str) -> None:
        """Show the kernel being compiled and the number begun."""
        total, bar = '', ''
        if self._expected is not None and count <= self._expected:
            total = f' of about {self._expected}'
            done = _BAR * count // self._expected
            bar = f'[{"#" * done}{"." * (_BAR - done)}] '
        text, now = f'Compiling kernels (once): {count}{total}: {what}', self._clock()
        if self._is_terminal:
            _write(f'\r\x1b[K{bar}{text}')
        elif self._next is None or now >= self._next:
            self._say(text)
        else:
            return
        self._next = now + _LINE_PERIOD

    def close(self) -> None:
        """Leave an empty line on a terminal."""
        if self._is_terminal and self._next is not None:
            _write('\r\x1b[K')


def _write(text: str) -> None:
    sys.stderr.write(text)
    sys.stderr.flush()


@contextmanager
def progress(
    expected: int | None = None, say: Callable[[str], object] | None = None
) -> Iterator[list[str]]:
    """Like `compilations`, with a `ProgressLine` of these arguments."""
    with (
        closing(ProgressLine(expected, say)) as line,
        compilations(
            lambda name: line.show(len(names), name),
            wait=lambda name: line.show(len(names), f'{name} (another process compiles it)'),
        ) as names,
    ):
        yield names
