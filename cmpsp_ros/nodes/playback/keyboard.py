"""Key presses in the terminal of a node, if it has one."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from typing import Any


class Keyboard:
    """Reads single keys; none without a terminal or in the background."""

    def __init__(self) -> None:
        """Switch the terminal to single keys."""
        self._before: list[Any] | None = None
        if _is_ours():
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)

    def pressed(self) -> str:
        """Keys pressed since the last call."""
        keys = ''
        while self._before is not None and select.select([sys.stdin], [], [], 0.0)[0]:
            key = os.read(sys.stdin.fileno(), 1).decode(errors='replace')
            if not key:
                self.close()
            keys += key
        return keys

    def close(self) -> None:
        """Restore the terminal; may be called twice."""
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)
            self._before = None


def _is_ours() -> bool:
    try:
        return sys.stdin.isatty() and os.tcgetpgrp(sys.stdin.fileno()) == os.getpgrp()
    except (OSError, ValueError, AttributeError):
        return False
