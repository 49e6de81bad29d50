"""Time that begins again: a simulation restarted, or a recording played in a loop."""

from __future__ import annotations

from cmpsp_ros.guidance.horizon import NANOSECONDS


class TimeJump:
    """Compares the stamps of odometry in the order of arrival."""

    def __init__(self) -> None:
        """Nothing has arrived yet."""
        self._latest: int | None = None

    def back(self, stamp: int) -> float:
        """How far odometry's time has jumped back since the last call [s]; negative: forward.

        A run begins again when that is more than `odom_timeout`.

        Args:
            stamp: Time stamp of the odometry [ns].
        """
        before = stamp if self._latest is None else self._latest
        self._latest = stamp
        return (before - stamp) / NANOSECONDS
