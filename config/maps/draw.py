"""Draws the maps beside it, as a mapper would have saved them: `python config/maps/draw.py`."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

RESOLUTION = 0.05
WALL = 0.1

Box = tuple[float, float, float, float]
"""Least x and y, greatest x and y [m]."""

WAREHOUSE = (
    12.0,
    8.0,
    [
        (2.0, 1.5, 2.8, 6.5),  # racks, of which one stands at either wall
        (4.4, 2.0, 5.2, 8.0),
        (6.8, 0.0, 7.6, 5.8),
        (9.2, 1.5, 10.0, 6.5),
        (3.3, 3.6, 3.7, 4.0),  # pallets
        (5.8, 3.0, 6.2, 3.6),
        (8.3, 4.6, 8.7, 5.2),
        (10.7, 2.6, 11.1, 3.2),
    ],
)
DOOR = (6.0, 4.0, [(2.9, 0.0, 3.0, 1.8), (2.9, 2.25, 3.0, 4.0)])
DEAD_END = (7.0, 5.0, [(2.0, 1.5, 4.1, 1.6), (2.0, 3.4, 4.1, 3.5), (4.0, 1.5, 4.1, 3.5)])


def shades(width: float, height: float, boxes: Iterable[Box]) -> NDArray[np.uint8]:
    """Shades of a room with boxes in it: black is occupied, and the first row is the top.

    Args:
        width: Along x [m].
        height: Along y [m].
        boxes: What stands in it.
    """
    rows, columns = round(height / RESOLUTION), round(width / RESOLUTION)
    walls = [
        (0.0, 0.0, width, WALL),
        (0.0, height - WALL, width, height),
        (0.0, 0.0, WALL, height),
        (width - WALL, 0.0, width, height),
    ]
    drawn = np.full((rows, columns), 254, np.uint8)
    for box in [*walls, *boxes]:
        left, bottom, right, top = (round(each / RESOLUTION) for each in box)
        drawn[bottom:top, left:right] = 0
    return drawn[::-1]


if __name__ == '__main__':
    for name, room in (('warehouse', WAREHOUSE), ('door', DOOR), ('dead_end', DEAD_END)):
        folder = Path(__file__).parent
        Image.fromarray(shades(*room)).save(folder / f'{name}.png')
        said = (
            f'image: {name}.png',
            'mode: trinary',
            f'resolution: {RESOLUTION}',
            'origin: [0.0, 0.0, 0.0]',
            'negate: 0',
            'occupied_thresh: 0.65',
            'free_thresh: 0.25',
        )
        (folder / f'{name}.yaml').write_text('\n'.join([*said, '']), encoding='utf-8')
