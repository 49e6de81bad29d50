"""ROS time that stands still: a paused simulation, or a `/clock` that has died."""

from __future__ import annotations

import time

_PATIENCE = 1.0


class ClockWatch:
    """Compares ROS time with the time that really passes.

    Nothing is commanded on account of it: while time stands still, so does what depends on it.
    """

    def __init__(self) -> None:
        """Nothing seen yet."""
        self._now: int | None = None
        self._since = 0.0

    def warnings(self, now: int) -> list[str]:
        """What is to be said of the clock, in sentences; to be asked a few times a second.

        Args:
            now: ROS time [ns].
        """
        seen_at = time.monotonic()
        if now != self._now:
            self._now, self._since = now, seen_at
        if seen_at - self._since <= _PATIENCE:
            return []
        return [f'The clock stands still at {now / 1e9:.3f} s: is /clock still published?']
