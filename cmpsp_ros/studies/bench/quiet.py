"""What would disturb a measurement or its report, kept out."""

from __future__ import annotations

import gc
import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout


@contextmanager
def collector_off() -> Iterator[None]:
    """Keep the garbage collector from running, and let it catch up before."""
    gc.collect()
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@contextmanager
def unheard() -> Iterator[None]:
    """Swallow what a solver prints: one that fails may print its whole problem."""
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        yield
