"""Filters for the motion of a person: constant velocity, disturbed by random accelerations."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

_NS: Final = 1_000_000_000
_FIRST_VELOCITY: Final = 1.0  # standard deviation of one not known yet [m/s]
_STRAIGHT, _TURNING = 0.03, 2.0  # accelerations of who walks straight, and of who turns [m^2/s^3]
_BEGINS, _ENDS = 0.3, 2.2  # rates at which people begin to turn, and end it [1/s]
_USUAL: Final = _BEGINS / (_BEGINS + _ENDS)  # share of time for which people turn
_CERTAIN: Final = 50.0  # logarithm of a ratio of likelihoods beyond which nothing changes


@dataclass
class MotionState:
    """Estimated position and velocity of an object; both axes have the same covariance."""

    stamp: int  # time of the state [ns]
    x: float  # centre [m]
    y: float  # centre [m]
    position_variance: float
    vx: float = 0.0
    vy: float = 0.0
    covariance: float = 0.0
    velocity_variance: float = _FIRST_VELOCITY**2

    @property
    def stddevs(self) -> tuple[float, float]:
        """Standard deviations of centre and velocity [m, m/s]."""
        return math.sqrt(self.position_variance), math.sqrt(self.velocity_variance)

    def surprise(self, x: float, y: float, variance: float) -> float:
        """Squared Mahalanobis distance of a place [m] that was seen with a variance [m^2]."""
        off_x, off_y = x - self.x, y - self.y
        return (off_x * off_x + off_y * off_y) / (self.position_variance + variance)

    def mix(self, one: MotionState, other: MotionState, weight: float) -> None:
        """Become the mean of two states at one time, with its covariance; `weight` of the other."""
        x, y, vx, vy = other.x - one.x, other.y - one.y, other.vx - one.vx, other.vy - one.vy
        left, spread = 1.0 - weight, 0.5 * weight * (1.0 - weight)
        self.stamp = one.stamp
        self.x, self.y = one.x + weight * x, one.y + weight * y
        self.vx, self.vy = one.vx + weight * vx, one.vy + weight * vy
        self.position_variance = (
            left * one.position_variance
            + weight * other.position_variance
            + spread * (x * x + y * y)
        )
        self.covariance = (
            left * one.covariance + weight * other.covariance + spread * (x * vx + y * vy)
        )
        self.velocity_variance = (
            left * one.velocity_variance
            + weight * other.velocity_variance
            + spread * (vx * vx + vy * vy)
        )

    def take(self, other: MotionState) -> None:
        """Become equal to another state."""
        self.stamp, self.x, self.y = other.stamp, other.x, other.y
        self.vx, self.vy = other.vx, other.vy
        self.position_variance, self.covariance = other.position_variance, other.covariance
        self.velocity_variance = other.velocity_variance


@dataclass
class MotionFilter(MotionState):
    """Kalman filter with one model."""

    agility: float = 0.2  # power spectral density of accelerations, white noise [m^2/s^3]

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


@dataclass
class InteractingFilters(MotionState):
    """Two Kalman filters, of straight walks and of turns, that interact; the state is their mean.

    Source: Blom, Bar-Shalom, The interacting multiple model algorithm for systems with Markovian
    switching coefficients, IEEE Transactions on Automatic Control 33 (8), 1988.
    """

    turning: float = 0.5  # probability that it turns
    straight: MotionFilter = field(init=False)  # filter of straight walks
    turn: MotionFilter = field(init=False)  # filter of turns

    def __post_init__(self) -> None:
        seen = self.stamp, self.x, self.y, self.position_variance
        self.straight = MotionFilter(*seen, agility=_STRAIGHT)
        self.turn = MotionFilter(*seen, agility=_TURNING)
        self.straight.take(self)
        self.turn.take(self)

    def predict(self, stamp: int) -> None:
        """Go on to a time [ns]."""
        if stamp <= self.stamp:
            return
        kept = math.exp((self.stamp - stamp) / _NS * (_BEGINS + _ENDS))
        before, self.turning = self.turning, _USUAL + (self.turning - _USUAL) * kept
        ended = before * (1.0 - _USUAL) * (1.0 - kept)
        begun = (1.0 - before) * _USUAL * (1.0 - kept)
        straight, turn = self.straight, self.turn
        self.mix(straight, turn, 1.0 - begun / self.turning)
        straight.mix(straight, turn, ended / (1.0 - self.turning))
        turn.take(self)
        straight.predict(stamp)
        turn.predict(stamp)
        self.mix(straight, turn, self.turning)

    def correct(self, x: float, y: float, variance: float) -> None:
        """Take in a centre [m] that was seen with a variance [m^2]."""
        seen = x, y, variance
        ratio = 0.5 * (self.straight.surprise(*seen) - self.turn.surprise(*seen))
        ratio = math.exp(min(max(ratio, -_CERTAIN), _CERTAIN))
        ratio *= self.straight.position_variance + variance
        ratio /= self.turn.position_variance + variance
        turns = ratio * self.turning
        self.turning = turns / (turns + (1.0 - self.turning))
        self.straight.correct(*seen)
        self.turn.correct(*seen)
        self.mix(self.straight, self.turn, self.turning)
