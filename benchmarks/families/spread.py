"""A sample of times in few numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike


@dataclass(frozen=True)
class Spread:
    """What there is to say about a sample, in its own unit.

    Attributes:
        count: Its size.
        median: Half of it is below.
        p99: 99th percentile; None below 100 values, where it would be the largest by another name.
        p999: 99.9th percentile; None below 1000 values.
        largest: Its maximum.
    """

    count: int
    median: float
    p99: float | None
    p999: float | None
    largest: float

    @classmethod
    def of(cls, values: ArrayLike) -> Spread:
        """Of at least one value, in any shape."""
        sample = np.asarray(values, float).ravel()
        return cls(
            sample.size,
            float(np.median(sample)),
            float(np.percentile(sample, 99.0)) if sample.size >= 100 else None,
            float(np.percentile(sample, 99.9)) if sample.size >= 1000 else None,
            float(sample.max()),
        )
