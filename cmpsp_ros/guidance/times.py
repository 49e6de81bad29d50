"""Times: integer nanoseconds since time 0, so that a run repeats exactly.

Apart from horizons, whose compiled code a reader of messages need not load.
"""

from __future__ import annotations

import math
from typing import Final

NANOSECONDS = 1_000_000_000

NEVER: Final = 2**62
"""A time that does not come [ns]."""


def to_nanoseconds(seconds: float) -> int:
    """Seconds as a whole number of nanoseconds, to the nearest; infinite ones are `NEVER`."""
    return round(seconds * NANOSECONDS) if seconds < math.inf else NEVER
