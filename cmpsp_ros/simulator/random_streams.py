"""Independent random streams from one seed, one for each thing that is random.

A stream is drawn from by nothing else: to turn one disturbance on changes no other's numbers.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What is random; a number is never given twice, for runs of before must repeat."""

    JITTER = 0
    SLIP = 1
    POSITION = 2
    HEADING = 3
    DROPOUT = 4
    RANGE = 5
    BEAM = 6
    ODOMETRY = 7


def generator(seed: int, stream: Stream) -> np.random.Generator:
    """The random numbers of one stream, from its beginning.

    Args:
        seed: Of the whole run.
        stream: Which of its streams.
    """
    # The same child as `SeedSequence(seed).spawn(n)[stream]`, whatever n is.
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(int(stream),)))
