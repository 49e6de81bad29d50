"""Static circular obstacles (93)."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Obstacle:
    """A disc to keep out of.

    Attributes:
        name: The user's name for it, used in messages.
        center: Centre (x, y) [m].
        radius: Radius [m].
    """

    name: str
    center: tuple[float, float]
    radius: float
