"""Groups of occupied cells that a way may pass on either side."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

Indices = NDArray[np.int64]

_MOST: Final = 24


def islands_of(occupied: NDArray[np.bool_]) -> Iterator[tuple[Indices, Indices]]:
    """Row and column of the middlemost cell of each group that does not touch the rim.

    Args:
        occupied: Shape ``(rows, columns)``. Of its groups the largest count.
    """
    # Where there is no grid it is not needed, and takes half a second to load.
    from scipy import ndimage  # noqa: PLC0415

    groups, count = ndimage.label(occupied, np.ones((3, 3)))
    rim = np.concatenate([groups[0], groups[-1], groups[:, 0], groups[:, -1]])
    inner = np.setdiff1d(np.arange(1, count + 1), rim)
    sizes = np.bincount(groups.ravel(), minlength=count + 1)[inner]
    for group in inner[np.argsort(-sizes, kind='stable')[:_MOST]]:
        cells = np.argwhere(groups == group)
        away = ((cells - cells.mean(axis=0)) ** 2).sum(axis=1)
        row, column = cells[np.argmin(away)]
        yield row, column
