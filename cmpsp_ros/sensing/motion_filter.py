"""Kalman filter of an object that moves at constant velocity, disturbed by accelerations."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

_NS: Final = 1_000_000_000
_FIRST_VELOCITY: Final = 1.0
"""Standard deviation of a velocity that is not known yet [m/s]."""


@dataclass
class MotionFilter:
    """Place and velocity of an object; both axes have the same covariance."""

    stamp: int  # time of the state [ns]
    x: float  # centre [m]
    y: float  # centre [m]
    position_variance: float
    vx: float = 0.0
    vy: float = 0.0
    covariance: float = 0.0
    velocity_variance: float = _FIRST_VELOCITY**2
    agility: float = 0.2  # power spectral density of accelerations, white noise [m^2/s^3]

    @property
    def stddevs(self) -> tuple[float, float]:
        """Standard deviations of centre and velocity [m, m/s]."""
        return math.sqrt(self.position_variance), math.sqrt(self.velocity_variance)

    def predict(self, stamp: int) -> None:
        """Go on to a time [ns]."""
        if stamp <= self.stamp:
            return
        h, self.stamp = (stamp - self.stamp) / _NS, stamp
        self.x, self.y = self.x + h * self.vx, self.y + h * self.vy
        added = self.agility * h
        self.position_variance += h * (2.0 * self.covariance + h * self.velocity_variance)
        self.position_variance += added * h * h / 3.0
        self.covariance += h * self.velocity_variance + added * h / 2.0
        self.velocity_variance += added

    def surprise(self, x: float, y: float, variance: float) -> float:
        """Squared Mahalanobis distance of a place [m] that was seen with a variance [m^2]."""
        off_x, off_y = x - self.x, y - self.y
        return (off_x * off_x + off_y * off_y) / (self.position_variance + variance)

    def correct(self, x: float, y: float, variance: float) -> None:
        """Take in a centre [m] that was seen with a variance [m^2]."""
        off_x, off_y = x - self.x, y - self.y
        total = self.position_variance + variance
        gain, velocity_gain = self.position_variance / total, self.covariance / total
        self.x, self.y = self.x + gain * off_x, self.y + gain * off_y
        self.vx, self.vy = self.vx + velocity_gain * off_x, self.vy + velocity_gain * off_y
        self.velocity_variance -= velocity_gain * self.covariance
        self.position_variance *= 1.0 - gain
        self.covariance *= 1.0 - gain
