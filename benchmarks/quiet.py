"""What would disturb a measurement or its report, kept out."""

from __future__ import annotations

import gc
import io
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout


@contextmanager
def collector_off() -> Iterator[None]:
    """Keep the garbage collector from running, as the guidance node does, and let it catch up.

    What exists by then is not looked at again, so that inside another one it catches up quickly.
    """
    was_on = gc.isenabled()
    gc.collect()
    if was_on:
        gc.freeze()
        gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.unfreeze()
            gc.enable()


@contextmanager
def unheard() -> Iterator[None]:
    """Swallow what a solver prints: one that fails may print its whole problem."""
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        yield
