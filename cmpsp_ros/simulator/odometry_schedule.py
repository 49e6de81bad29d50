"""Instants of odometry: a time grid, and a random delay after each of its points."""

from __future__ import annotations

from cmpsp_ros.simulator.random_streams import Stream, generator
from cmpsp_ros.simulator.settings import PlantSettings

_NS = 1_000_000_000


class OdometrySchedule:
    """When a robot measures its pose.

    Attributes:
        next_ns: The next instant [ns].
        period_ns: Distance of the grid's points [ns].
    """

    def __init__(self, settings: PlantSettings, start_ns: int) -> None:
        """Begin the grid.

        Args:
            settings: Rate, jitter and seed; a jitter shorter than the period keeps the order.
            start_ns: First point of the grid [ns].
        """
        self.period_ns = round(_NS / settings.odom_rate)
        self._jitter = settings.odom_jitter
        self._random = generator(settings.seed, Stream.ODOMETRY)
        self._point_ns = start_ns - self.period_ns
        self.advance()

    def advance(self) -> None:
        """Go on to the instant after the next."""
        self._point_ns += self.period_ns
        late = self._jitter * self._random.random() if self._jitter else 0.0
        self.next_ns = self._point_ns + round(late * _NS)
