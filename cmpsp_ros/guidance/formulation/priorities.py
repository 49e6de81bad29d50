"""Which constraints give way first where not all can be met: plans and their ranking follow it."""

from __future__ import annotations

from types import MappingProxyType
from typing import Final

PENALTIES: Final = MappingProxyType({'obstacle': 1e4, 'edge': 3e3, 'terminal_error': 1e3})
"""Cost of violating a constraint by a metre, in the merit function and in the relaxation [1/m].

The heavier outranks the lighter, however little of it is violated. The names are those of
`ranking.Score`. The audit knows no order: no first arc may touch an edge or an obstacle.
"""

BY_PRIORITY: Final = tuple(sorted(PENALTIES, key=lambda each: -PENALTIES[each]))
"""What is violated last comes first."""
