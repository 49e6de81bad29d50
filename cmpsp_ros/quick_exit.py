"""The end of a process, without taking it apart."""

from __future__ import annotations

import atexit
import gc
import os
import sys
import threading
from typing import NoReturn


def quick_exit(code: int) -> NoReturn:
    """End the process, as the last thing that it does.

    Python would first take apart every module, for a third of a second where numba is among them.
    What matters of that is done: whatever was registered for the end, unused objects with what they
    hold of the system, and output. With other threads at work Python's own way is gone.

    Args:
        code: The exit code.

    Raises:
        SystemExit: There are other threads to be waited for.
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
