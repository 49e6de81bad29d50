"""The style of all pictures: that of a journal, independent of the user's matplotlib settings."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

import matplotlib as mpl

WIDTH: Final = 7.2
"""Width of a picture across both columns of a page [in]."""

# Of type Any: matplotlib lists every key of its settings as a literal of its own.
_RC: Final[Any] = {
    'font.family': 'sans-serif',
    'font.sans-serif': ['DejaVu Sans'],
    'font.size': 8.0,
    'axes.titlesize': 8.0,
    'axes.labelsize': 8.0,
    'xtick.labelsize': 7.0,
    'ytick.labelsize': 7.0,
    'legend.fontsize': 7.0,
    'legend.frameon': False,
    'axes.linewidth': 0.6,
    'lines.linewidth': 1.1,
    'xtick.direction': 'in',
    'ytick.direction': 'in',
    'grid.linewidth': 0.4,
    'grid.color': '0.85',
    # Text stays text, and the names of clip paths do not change from one run to the next.
    'svg.fonttype': 'none',
    'svg.hashsalt': 'cmpsp',
}


@contextmanager
def journal() -> Iterator[None]:
    """Draw and save in this look."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_RC)
        yield
