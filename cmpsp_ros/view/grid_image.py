"""A grid as a small picture, for pages."""

from __future__ import annotations

import base64
import io
import math
from typing import Any, Final

import numpy as np
from PIL import Image

from cmpsp_ros.view.palette import SEEN, UNSEEN
from cmpsp_ros.world.grids import OccupancyGrid

_MOST: Final = 256
"""Pixels along a side at most."""

# Of free, unknown and occupied cells, from the least to what hides the others.
_RANKS: Final = np.array([0, 2, 1], dtype=np.uint8)
_COLORS: Final = bytes.fromhex(''.join(each[1:] for each in ('#ffffff', UNSEEN, SEEN)))
_OPACITY: Final = bytes([0, 255, 255])


def grid_picture(grid: OccupancyGrid) -> dict[str, Any]:
    """A picture of a grid along the axes, bounded in size, and where it is [m].

    Free cells are transparent. Of several cells in a pixel an occupied one is shown.

    Returns:
        Left edge ``x``, upper edge ``y``, ``width``, ``height``, and ``source``, a data URL.
    """
    high, wide = grid.cells.shape
    step = math.ceil(max(high, wide) / _MOST)
    pixels = np.maximum.reduceat(_RANKS[grid.cells], np.arange(0, high, step), axis=0)
    pixels = np.maximum.reduceat(pixels, np.arange(0, wide, step), axis=1)
    image = Image.fromarray(pixels[::-1], 'P')
    image.putpalette(_COLORS)
    file = io.BytesIO()
    image.save(file, 'PNG', transparency=_OPACITY, bits=2)
    # The last pixels may stand for fewer cells: the picture reaches beyond the grid by them.
    width, height = (step * grid.resolution * count for count in pixels.shape[::-1])
    left, bottom, _ = grid.origin
    return {
        'x': round(left, 6),
        'y': round(bottom + height, 6),
        'width': round(width, 6),
        'height': round(height, 6),
        'source': f'data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}',
    }
