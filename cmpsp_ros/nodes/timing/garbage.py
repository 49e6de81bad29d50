"""Python's garbage collector, run between control steps only."""

from __future__ import annotations

import gc
import math
import time

_YOUNG, _FULL = 1, 2
_FULL_EVERY = 50
_SHARE_OF_SLACK = 0.25
_OVERDUE = 1.0


class GarbageCollection:
    """Collects garbage on request instead of automatically.

    Objects that exist at its start are not examined again, so only the few objects of a control
    step remain.
    """

    def __init__(self) -> None:
        """Change nothing until `begin`."""
        self._on = False

    @property
    def overdue(self) -> bool:
        """Whether there was no time for it for so long that some must be taken."""
        return self._on and time.monotonic() - self._latest > _OVERDUE

    def settle(self) -> None:
        """Go through the whole heap, once: it takes a tenth of a second, in which nobody waits."""
        gc.collect()
        gc.freeze()

    def begin(self) -> None:
        """Take it over from Python."""
        self._took = {_YOUNG: 0.0, _FULL: 0.0}
        self._since_full = 0
        self._latest = time.monotonic()
        self._on = True
        self.settle()
        gc.disable()

    def end(self) -> None:
        """Give it back to Python."""
        gc.unfreeze()
        if self._on:
            self._on = False
            gc.enable()

    def collect(self, slack: float = math.inf) -> None:
        """Collect, if that takes a small part of the time there is.

        Args:
            slack: Time until the next control step [s].
        """
        if not self._on:
            return
        fits = [each for each, took in self._took.items() if took <= _SHARE_OF_SLACK * slack]
        full_due = self._since_full >= _FULL_EVERY
        if _FULL in fits and full_due:
            self._collect(_FULL)
            self._since_full = 0
        elif _YOUNG in fits:
            self._collect(_YOUNG)
            self._since_full += 1

    def _collect(self, generation: int) -> None:
        self._latest = time.monotonic()
        gc.collect(generation)
        self._took[generation] = time.monotonic() - self._latest
