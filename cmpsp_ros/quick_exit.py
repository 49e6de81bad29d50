"""The end of a process, without taking it apart."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
from typing import NoReturn


def quick_exit(code: int) -> NoReturn:
    """End the process with an exit code, skipping the teardown of modules.

    With numba the teardown takes a third of a second. Exit handlers, garbage collection and
    flushing of output are done. With other threads running, Python's own exit is used.

    Raises:
        SystemExit: Other threads are running.
    """
    others = [each for each in threading.enumerate() if not each.daemon]
    if others != [threading.main_thread()]:
        sys.exit(code)
    atexit._run_exitfuncs()  # noqa: SLF001 (there is no other way to do it early)
    gc.collect()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            code = code or 1
    os._exit(code)
