"""Goals with times, terminal targets, and settings to follow a road without end."""

import math
from dataclasses import dataclass
from typing import NamedTuple

from numpy import float64
from numpy.typing import NDArray

Point = tuple[float, float]


class GoalError(ValueError):
    """A goal that is refused; the message says why."""


@dataclass(frozen=True)
class Goal:
    """A point to pass at a time."""

    position: Point  # (x, y) [m]
    time: float  # when to pass it, from the first odometry [s]
    heading: float | None = None  # heading to pass it with [rad]; None for any
    name: str = ''  # name in decisions; empty if it is the only one


@dataclass(frozen=True)
class Follow:
    """Following the road at a speed, without an end."""

    speed: float  # mean speed along the centre line, negative against its direction [m/s]
    horizon: float  # time that plans look ahead [s]

    @property
    def arc_length(self) -> float:
        """Arc length of the centre line within the horizon, negative against it [m]."""
        return self.speed * self.horizon


class Target(NamedTuple):
    """Terminal target of a plan."""

    position: Point  # (x, y) [m]
    heading: float | None = None  # required there; of a line the road's [rad]; None for any
    is_line: bool = False  # true for the line through it across the heading, which is free then
    drives_on: bool = False  # true if another goal comes after this one

    def distance(self, x: float, y: float) -> float:
        """Distance of a point [m] from it [m]."""
        if not self.is_line or self.heading is None:
            return math.dist((x, y), self.position)
        dx, dy = x - self.position[0], y - self.position[1]
        return abs(math.cos(self.heading) * dx + math.sin(self.heading) * dy)

    def errors(self, pose: NDArray[float64]) -> tuple[float, float | None]:
        """Distance [m] and heading difference [rad] of a pose; None where any heading will do."""
        x, y, heading = pose.tolist()
        if self.heading is None or self.is_line:
            return self.distance(x, y), None
        return self.distance(x, y), abs(math.remainder(heading - self.heading, math.tau))
