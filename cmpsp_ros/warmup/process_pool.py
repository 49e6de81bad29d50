"""Processes that share work on this machine."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import connection, get_context, parent_process
from typing import Any


def new_pool(workers: int, *begin: Any) -> ProcessPoolExecutor:
    """Processes that leave the keyboard to their parent, and end when it does, however it ends.

    Args:
        workers: How many.
        begin: A function that each of them calls first, and its arguments.
    """
    # A fork would copy the locks of the numerical libraries' threads.
    return ProcessPoolExecutor(workers, get_context('spawn'), partial(_begin, *begin))


def _begin(call: Callable[..., None] | None = None, *arguments: Any) -> None:
    if call is not None:
        call(*arguments)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    # A worker whose parent was killed would wait for work for ever.
    connection.wait([sentinel])
    os._exit(1)
