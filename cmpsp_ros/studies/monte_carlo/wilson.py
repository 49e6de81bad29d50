"""Wilson's interval for a proportion: sensible at 0 of n and n of n too, frequent as they are."""

from __future__ import annotations

import math
from typing import Final

NORMAL_95: Final = 1.959963984540054
"""Quantile of the normal distribution that leaves 2.5 % on either side."""


def wilson(count: int, total: int, quantile: float = NORMAL_95) -> tuple[float, float]:
    """Where the proportion lies that gave so many of so many.

    E. B. Wilson, Probable inference, the law of succession, and statistical inference, J. Am.
    Stat. Assoc. 22 (1927).

    Args:
        count: Of what was counted.
        total: Out of how many; with none at all it may be anything.
        quantile: Of the normal distribution, for the confidence wanted.

    Returns:
        Lower and upper end.

    Raises:
        ValueError: There is no such count.
    """
    if not 0 <= count <= total:
        raise ValueError(f'count: found {count} of {total}, wanted 0 to {total}')
    if total == 0:
        return 0.0, 1.0
    share, square = count / total, quantile**2
    middle = share + square / (2.0 * total)
    half = quantile * math.sqrt(share * (1.0 - share) / total + square / (4.0 * total**2))
    scale = 1.0 + square / total
    # Rounding must not leave an end that should be exactly 0 or 1 beside it.
    low = 0.0 if count == 0 else (middle - half) / scale
    high = 1.0 if count == total else (middle + half) / scale
    return low, high
