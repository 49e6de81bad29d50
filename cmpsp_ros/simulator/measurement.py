"""Measured odometry: noise, bias, drift, losses, instants, and the random streams of a run."""

from enum import IntEnum

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.simulator.settings import OdometryErrors, PlantSettings


class Measurement:
    """Odometry of one run, a message each call; noise does not depend on which are lost."""

    def __init__(self, seed: int) -> None:
        self._position = generator(seed, Stream.POSITION)
        self._heading = generator(seed, Stream.HEADING)
        self._dropout = generator(seed, Stream.DROPOUT)

    def measure(self, errors: OdometryErrors, elapsed: float, pose: Array) -> Array | None:
        """The pose measured ``(3,)`` after a time [s], or None if the message is lost."""
        measured = np.array(pose, dtype=float)
        if errors.position_stddev:
            measured[:2] += errors.position_stddev * self._position.standard_normal(2)
        if errors.heading_stddev:
            measured[2] += errors.heading_stddev * self._heading.standard_normal()
        if any(errors.bias):
            measured += errors.bias
        if any(errors.drift):
            measured += np.multiply(errors.drift, elapsed)
        # Drawn in a window too: later losses do not depend on it.
        lost = bool(errors.dropout) and self._dropout.random() < errors.dropout
        if lost or any(begin <= elapsed < end for begin, end in errors.dropout_windows):
            return None
        return measured


class Stream(IntEnum):
    """Random streams; a number is never used twice, since earlier runs must repeat."""

    JITTER = 0
    SLIP = 1
    POSITION = 2
    HEADING = 3
    DROPOUT = 4
    RANGE = 5
    BEAM = 6
    ODOMETRY = 7
    PEOPLE = 8


def generator(seed: int, stream: Stream) -> np.random.Generator:
    """The random numbers of one stream of a run, from its beginning."""
    # The same child as `SeedSequence(seed).spawn(n)[stream]`, for any n.
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(stream),)))


_NS = 1_000_000_000


class OdometrySchedule:
    """When a robot measures its pose: the next instant, and the period of the grid [ns]."""

    def __init__(self, settings: PlantSettings, start_ns: int) -> None:
        """Begin the grid at an instant [ns]; a jitter shorter than the period keeps the order."""
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
