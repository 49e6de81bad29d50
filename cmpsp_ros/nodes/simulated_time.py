"""Simulated time in the past, by the system's clock."""

from __future__ import annotations

from bisect import bisect_right

_KEPT = 100_000


class SimulatedTime:
    """What `/clock` told, and when it was published.

    In lockstep much simulated time passes in the time that a message takes to a busy recorder: what
    counts is when it left.
    """

    def __init__(self) -> None:
        """Nothing has been told."""
        self._published: list[int] = []
        self._told: list[int] = []

    def tell(self, published: int, time: int) -> None:
        """A message of `/clock` was published at a time of the system [ns] and told this one."""
        at = bisect_right(self._published, published)
        self._published.insert(at, published)
        self._told.insert(at, time)
        if len(self._told) > 2 * _KEPT:
            del self._published[:_KEPT], self._told[:_KEPT]

    def at(self, published: int) -> int | None:
        """Simulated time when something was published [ns]; None before anything was told."""
        if not self._told:
            return None
        return self._told[max(bisect_right(self._published, published) - 1, 0)]
