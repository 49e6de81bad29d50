"""The road: what the robot stays inside, and whose centre line it keeps to."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Annulus:
    """The curved road (92), between two concentric circles.

    Attributes:
        center: Centre of both circles (x, y) [m].
        inner_radius: ``r_i`` [m].
        outer_radius: ``r_o`` [m].
    """

    center: tuple[float, float] = (0.0, 0.0)
    inner_radius: float = 9.0
    outer_radius: float = 11.0

    @property
    def center_radius(self) -> float:
        """Radius ``r_p`` of the centre line [m]."""
        return (self.inner_radius + self.outer_radius) / 2.0
