"""Pictures of grids: which way up, where they are, and how large they may become."""

import base64
import io

import numpy as np
import pytest
from PIL import Image

from cmpsp_ros.view import SEEN, UNSEEN, grid_picture
from cmpsp_ros.world.grids import Cell, OccupancyGrid


def pixels(picture):
    head, data = picture['source'].split(',')
    assert head == 'data:image/png;base64'
    return Image.open(io.BytesIO(base64.b64decode(data))).convert('RGBA')


def rgb(color):
    return tuple(bytes.fromhex(color[1:]))


def test_a_pixel_for_each_cell_with_the_first_row_below():
    cells = np.full((3, 4), Cell.FREE, np.uint8)
    cells[0, 1], cells[2, 3], cells[1, 2] = Cell.OCCUPIED, Cell.UNKNOWN, Cell.REMEMBERED

    picture = grid_picture(OccupancyGrid((-1.0, 2.0, 0.0), 0.5, cells))
    image = pixels(picture)

    assert [picture[each] for each in ('x', 'y', 'width', 'height')] == [-1.0, 3.5, 2.0, 1.5]
    assert image.size == (4, 3)
    assert image.getpixel((1, 2)) == (*rgb(SEEN), 255)
    assert image.getpixel((3, 0)) == (*rgb(UNSEEN), 255)
    assert image.getpixel((0, 0))[3] == image.getpixel((2, 1))[3] == 0


@pytest.mark.parametrize('shape', [(1000, 300), (257, 257), (1, 2000)])
def test_it_is_small_whatever_the_grid_and_hides_nothing_occupied(shape):
    cells = np.full(shape, Cell.UNKNOWN, np.uint8)
    cells[0, 150] = Cell.OCCUPIED
    cells[-1, :100] = Cell.FREE

    picture = grid_picture(OccupancyGrid((0.0, 0.0, 0.0), 0.05, cells))
    image = pixels(picture)

    assert max(image.size) <= 256
    column = int(150 * 0.05 / picture['width'] * image.size[0])
    assert image.getpixel((column, image.size[1] - 1)) == (*rgb(SEEN), 255)
    assert picture['y'] == pytest.approx(picture['height'])
    assert picture['height'] >= 0.05 * shape[0]
    assert len(picture['source']) < 40_000
