"""What odometry makes of the true pose: noise, bias, drift, and messages that never come."""

from __future__ import annotations

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.simulator.random_streams import Stream, generator
from cmpsp_ros.simulator.settings import OdometryErrors


class Measurement:
    """Odometry of one run.

    Each call of `measure` is one message. It takes its numbers from streams of its own, also when
    it is lost, so that the noise of the others does not depend on which are.
    """

    def __init__(self, seed: int) -> None:
        """Begin the streams of a run."""
        self._position = generator(seed, Stream.POSITION)
        self._heading = generator(seed, Stream.HEADING)
        self._dropout = generator(seed, Stream.DROPOUT)

    def measure(self, errors: OdometryErrors, elapsed: float, pose: Array) -> Array | None:
        """One message.

        Args:
            errors: How it differs from the truth.
            elapsed: Time since the start [s].
            pose: True pose, shape ``(3,)`` [m, m, rad].

        Returns:
            The pose measured, shape ``(3,)``, or None if the message is lost.
        """
        measured = np.array(pose, dtype=float)
        if errors.position_stddev:
            measured[:2] += errors.position_stddev * self._position.standard_normal(2)
        if errors.heading_stddev:
            measured[2] += errors.heading_stddev * self._heading.standard_normal()
        if any(errors.bias):
            measured += errors.bias
        if any(errors.drift):
            measured += np.multiply(errors.drift, elapsed)
        # Drawn in a window too: what is lost afterwards does not depend on it.
        lost = bool(errors.dropout) and self._dropout.random() < errors.dropout
        if lost or any(begin <= elapsed < end for begin, end in errors.dropout_windows):
            return None
        return measured
