"""One object in sight: filter of its motion, how large it is, and evidence that it moves."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

from cmpsp_ros.arrays import Array
from cmpsp_ros.sensing.motion_filter import InteractingFilters
from cmpsp_ros.sensing.track import Track

_NS: Final = 1_000_000_000
_ASIDE: Final = 0.3  # distance from where it is expected of one that was lost (one sigma) [m]
_DIFFERENT: Final = 4.0  # squared Mahalanobis distance of velocities that differ
_RISE, _FALL = 0.5, 0.1  # fractions by which the radius follows greater and smaller ones
_INTO: Final = 0.1  # depth in the robot from which somebody must have stopped [m]
_SETS_OFF: Final = 0.3  # standard deviation of the velocity of somebody who had to stop [m/s]
_NEARBY, _SETTLED = 0.3, _NS * 8 // 10
"""Distance within which somebody has to stay [m], and for how long, to be seen as static [ns]."""
_STILL_SPEED, _STILL_AFTER = 0.15, _NS  # of what stands still [m/s], and until it is static [ns]


@dataclass(kw_only=True)
class MovingObject(InteractingFilters):
    """State of an object."""

    number: int  # unique in a run; cells that it has marked in the grid bear it
    radius: float  # radius of a disc that covers it [m]
    begun: int  # time at which it was first seen [ns]
    seen: int  # time at which it was last seen [ns]
    origin: tuple[float, float]  # place of its nearest point at first, ``(x, y)`` [m]
    name: int = 0  # number among those that have moved; 0 for none yet
    is_moving: bool = False  # whether it counts as moving
    evidence: int = 0  # scans that showed that it moves, less those that did not
    gone: int = 0  # scans in a row that saw through the place where it should be
    still: int = 0  # time in sight for which it has stood still [ns]
    unproved: int = 0  # time in sight since a scan last showed that it moves [ns]
    sightings: int = 1  # number of scans that have shown it
    # Where it was seen lately, ``(stamp, x, y)`` [ns, m, m].
    seen_at: deque[tuple[int, float, float]] = field(default_factory=deque)
    is_lost: bool = False  # whether it may be anywhere, and is remembered only for its name

    def see(self, x: float, y: float, radius: float, variance: float) -> None:
        """Take in a centre [m] that was seen with a variance [m^2], and how large it looked."""
        self.correct(x, y, variance)
        change = radius - self.radius
        self.radius += (_RISE if change > 0.0 else _FALL) * change
        self.seen, self.gone = self.stamp, 0
        self.seen_at.append((self.stamp, self.x, self.y))
        while len(self.seen_at) > 1 and self.seen_at[1][0] <= self.stamp - _SETTLED:
            self.seen_at.popleft()

    def part_from(self, other: MovingObject) -> None:
        """Count as moving, with the velocity of the mover that it was taken for a part of."""
        self.is_moving = True
        for each in (self, self.straight, self.turn):
            each.vx, each.vy = other.vx, other.vy

    def stop_before(self, robot: Array) -> None:
        """Stand where it touches a robot of discs (x, y, radius), ``(D, 3)`` [m], if it is in it.

        Nobody walks through the robot.
        """
        for x, y, radius in robot.tolist():
            off_x, off_y = self.x - x, self.y - y
            away, apart = math.hypot(off_x, off_y), self.radius + radius
            if apart - away <= _INTO or off_x * self.vx + off_y * self.vy >= 0.0:
                continue
            out = (apart - away) / max(away, 1e-9)
            for each in (self, self.straight, self.turn):
                each.x, each.y = each.x + out * off_x, each.y + out * off_y
                each.vx = each.vy = each.covariance = 0.0
                each.velocity_variance = max(each.velocity_variance, _SETS_OFF * _SETS_OFF)

    def distance(self, other: MovingObject) -> float:
        """Squared Mahalanobis distance of the place of another, at the same time."""
        return self.surprise(other.x, other.y, other.position_variance + _ASIDE * _ASIDE)

    def moves_like(self, other: MovingObject) -> bool:
        """True if both may have the same velocity; two who meet do not."""
        off_x, off_y = self.vx - other.vx, self.vy - other.vy
        variance = self.velocity_variance + other.velocity_variance
        return off_x * off_x + off_y * off_y <= _DIFFERENT * variance

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return math.hypot(self.vx, self.vy)

    @property
    def has_settled(self) -> bool:
        """True if it has been about here for so long that what is seen of it may be static."""
        before, latest = None, self.stamp - _SETTLED
        for each in self.seen_at:
            if each[0] > latest:
                break
            before = each
        return before is not None and math.dist(before[1:], (self.x, self.y)) <= _NEARBY

    def settle(self, elapsed: int, *, moves: bool) -> None:
        """Count as static again after some time in sight [ns] without motion or evidence for it."""
        elapsed = min(elapsed, _STILL_AFTER // 4)
        self.still = 0 if self.speed > _STILL_SPEED else self.still + elapsed
        self.unproved = 0 if moves else self.unproved + elapsed
        if max(self.still, self.unproved) > _STILL_AFTER:
            self.is_moving, self.evidence = False, 0

    def track(self, stamp: int) -> Track:
        """Prediction for a time [ns]."""
        h = max(stamp - self.stamp, 0) / _NS
        spread = h * (2.0 * self.covariance + h * self.velocity_variance)
        return Track(
            Track.SEEN + self.name,
            stamp,
            self.radius,
            self.x + h * self.vx,
            self.y + h * self.vy,
            self.vx,
            self.vy,
            math.sqrt(self.position_variance + spread),
            math.sqrt(self.velocity_variance),
        )
