"""Odometry that stays away."""

from __future__ import annotations

_NANOSECONDS = 1e9


class OdometryWatchdog:
    """How long ago odometry was heard of that could be used.

    Before the first there is no silence.
    """

    def __init__(self) -> None:
        """Nothing has been heard."""
        self._heard_at: int | None = None
        self._noticed_at: int | None = None

    def end(self, now: int) -> None:
        """Odometry has come at a time [ns]."""
        self._heard_at = now

    def age(self, now: int) -> float | None:
        """For how long nothing has come [s]; None if nothing ever has."""
        return None if self._heard_at is None else (now - self._heard_at) / _NANOSECONDS

    def is_longer_than(self, timeout: float, now: int) -> bool:
        """Whether nothing has come for longer than that [s]."""
        age = self.age(now)
        return age is not None and age > timeout

    def goes_on(self, timeout: float, now: int) -> bool:
        """Whether it was too long already when this was asked before, at another time.

        A clock that jumps wakes who asks before the odometry that comes with it.
        """
        if not self.is_longer_than(timeout, now):
            self._noticed_at = None
        elif self._noticed_at is None:
            self._noticed_at = now
        else:
            return now > self._noticed_at
        return False
