"""The time of a recording during playback: scaled by a rate, and pausable."""

from __future__ import annotations


class PlaybackRate:
    """Bag time from wall time.

    It reads no clock: `now` is the time of a clock that never jumps [ns].
    """

    def __init__(self, rate: float) -> None:
        """Begin at bag time 0, paused.

        Args:
            rate: Seconds of bag time in a second of wall time; positive.
        """
        self._rate = rate
        self._stamp = 0
        self._since: int | None = None

    @property
    def paused(self) -> bool:
        """Whether bag time is paused."""
        return self._since is None

    def go_to(self, stamp: int, now: int) -> None:
        """Jump to a bag time [ns]."""
        self._stamp = stamp
        if self._since is not None:
            self._since = now

    def pause(self, now: int) -> None:
        """Stand still from now on."""
        self._stamp, self._since = self.stamp(now), None

    def resume(self, now: int) -> None:
        """Resume."""
        self.pause(now)
        self._since = now

    def stamp(self, now: int) -> int:
        """Bag time [ns]."""
        if self._since is None:
            return self._stamp
        return self._stamp + int((now - self._since) * self._rate)

    def until(self, stamp: int, now: int) -> int:
        """Wall time to wait for a bag time, if it is not paused [ns]; 0 when it is over."""
        return max(0, int((stamp - self.stamp(now)) / self._rate))
