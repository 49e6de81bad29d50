"""Maps of map_server become parameters, and what is no map is refused with the key at fault."""

import runpy
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from cmpsp_ros.guidance import MAP
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    config_directory,
    guidance_settings,
    load_parameter_file,
    text_of,
)
from cmpsp_ros.parameters.files import with_files
from cmpsp_ros.parameters.files.map_files import read_map
from cmpsp_ros.parameters.obstacles import map_of
from cmpsp_ros.world.grids import Cell, OccupancyGrid

FREE, OCCUPIED, UNKNOWN = map(int, (Cell.FREE, Cell.OCCUPIED, Cell.UNKNOWN))
SHADES = np.array([[0, 254, 205, 100], [254, 254, 60, 80]], np.uint8)
YAML = 'image: map.pgm\nresolution: 0.1\norigin: [1.0, 2.0, 0.5]\n'


def written(folder: Path, text: str = YAML, shades: np.ndarray = SHADES, name='map.pgm') -> Path:
    Image.fromarray(shades).save(folder / name)
    path = folder / 'map.yaml'
    path.write_text(text)
    return path


def grid_of(settings) -> OccupancyGrid:
    return next(each.grid for each in settings.obstacles if each.name == MAP)


@pytest.mark.parametrize(
    ('more', 'wanted'),
    [
        # White is free and black occupied, and the picture begins at the top.
        ('', [[FREE, FREE, OCCUPIED, OCCUPIED], [OCCUPIED, FREE, FREE, UNKNOWN]]),
        ('mode: scale\n', [[FREE, FREE, OCCUPIED, OCCUPIED], [OCCUPIED, FREE, FREE, UNKNOWN]]),
        ('negate: 1\n', [[OCCUPIED, OCCUPIED, FREE, UNKNOWN], [FREE, OCCUPIED, OCCUPIED, UNKNOWN]]),
        # Percentages, beyond 100 unknown.
        (
            'mode: raw\n',
            [[UNKNOWN, UNKNOWN, UNKNOWN, OCCUPIED], [FREE, UNKNOWN, UNKNOWN, OCCUPIED]],
        ),
        (
            'occupied_thresh: 0.9\nfree_thresh: 0.1\n',
            [[FREE, FREE, UNKNOWN, UNKNOWN], [OCCUPIED, FREE, UNKNOWN, UNKNOWN]],
        ),
    ],
)
def test_shades_are_read_as_map_server_does(tmp_path, more, wanted):
    grid = read_map(written(tmp_path, YAML + more))
    assert grid.cells.tolist() == wanted
    assert (grid.origin, grid.resolution) == ((1.0, 2.0, 0.5), 0.1)


def test_what_is_transparent_is_unknown_in_scale_mode_only(tmp_path):
    shades = np.zeros((1, 2, 4), np.uint8)
    shades[..., :3], shades[0, 0, 3] = 254, 255
    text = YAML.replace('pgm', 'png')
    scaled = read_map(written(tmp_path, f'{text}mode: scale\n', shades, 'map.png'))
    plain = read_map(written(tmp_path, text, shades, 'map.png'))
    assert scaled.cells.tolist() == [[FREE, UNKNOWN]]
    assert plain.cells.tolist() == [[FREE, FREE]]


def test_a_map_beside_its_parameter_file_is_one_more_obstacle(tmp_path, monkeypatch):
    monkeypatch.chdir('/')
    written(tmp_path)
    course = tmp_path / 'course.yaml'
    course.write_text(
        '/**:\n  ros__parameters:\n    map: {file: map.yaml, unknown_is_free: true}\n'
    )
    settings = guidance_settings(TABLE.resolve(load_parameter_file(course)))
    (only,) = settings.obstacles
    assert (only.name, only.unknown_is_free) == (MAP, True)
    assert grid_of(settings).origin == (1.0, 2.0, 0.5)


def test_parameters_hold_the_map_itself(tmp_path):
    values = TABLE.resolve(with_files({'map.file': str(written(tmp_path))}))
    (tmp_path / 'map.pgm').unlink()
    # As a bag has them.
    again = map_of(TABLE.resolve(values))
    assert again is map_of(values)
    assert again.grid.cells.tolist() == [
        [FREE, FREE, OCCUPIED, OCCUPIED],
        [OCCUPIED, FREE, FREE, UNKNOWN],
    ]


@pytest.mark.parametrize(
    ('text', 'where'),
    [
        ('image: map.pgm\norigin: [0, 0, 0]\n', 'resolution'),
        (YAML.replace('0.1', '0'), 'resolution'),
        (YAML.replace('0.1', '.nan'), 'resolution'),
        (YAML.replace('1.0, ', ''), 'origin'),
        (YAML.replace('1.0', '.inf'), 'origin'),
        (YAML.replace('map.pgm', '5'), 'image'),
        (YAML.replace('map.pgm', 'none.pgm'), 'none.pgm'),
        (YAML.replace('map.pgm', 'map.yaml'), 'map.yaml'),
        (YAML + 'mode: grey\n', 'mode'),
        (YAML + 'negate: 2\n', 'negate'),
        (YAML + 'occupied_thresh: 2.0\n', 'occupied_thresh'),
        (YAML + 'free_thresh: 0.7\n', 'free_thresh'),
        ('just text', 'map.yaml'),
        ('[1', 'map.yaml'),
    ],
)
def test_a_file_that_is_no_map_is_refused(tmp_path, text, where):
    path = written(tmp_path, text)
    with pytest.raises(ParameterError) as caught:
        with_files({'map.file': str(path)})
    (problem,) = caught.value.problems
    assert where in problem.where


@pytest.mark.parametrize(
    ('damage', 'said'),
    [(lambda data: data[:-3], r'map\.pgm'), (lambda _: b'P5 40000 30000 255\n', 'pixels')],
    ids=['cut off', 'too many cells'],
)
def test_a_picture_that_is_none_is_refused(tmp_path, damage, said):
    path, picture = written(tmp_path), tmp_path / 'map.pgm'
    picture.write_bytes(damage(picture.read_bytes()))
    with pytest.raises(ParameterError, match=said):
        with_files({'map.file': str(path)})


@pytest.mark.parametrize('name', [3, 'map.png', 'none.yaml'])
def test_a_name_of_no_map_is_refused(name):
    with pytest.raises(ParameterError):
        with_files({'map.file': name})


WALL = text_of(np.array([[FREE, OCCUPIED]], np.uint8))


@pytest.mark.parametrize(
    ('values', 'where'),
    [
        ({'map.cells': 'cells'}, 'map.cells'),
        ({'map.cells': WALL.replace('1 x 2', '2 x 2')}, 'map.cells'),
        ({'map.cells': WALL.replace('1 x 2', '0 x 2')}, 'map.cells'),
        ({'map.cells': WALL.replace('1 x 2', '99999 x 99999')}, 'map.cells'),
        ({'map.cells': f'{WALL[:-8]}AAAA'}, 'map.cells'),
        ({'map.cells': '1 x 2 AAAA'}, 'map.cells'),
        ({'map.cells': text_of(np.full((2, 2), len(Cell), np.uint8))}, 'map.cells'),
        ({'map.cells': text_of(np.full((2, 2), OCCUPIED, np.uint8))}, 'map.cells'),
        ({'map.cells': text_of(np.full((2, 2), UNKNOWN, np.uint8))}, 'map.cells'),
        (
            {
                'map.cells': WALL,
                'obstacles.names': ['map'],
                'obstacles.map.center': [3.0, 3.0],
                'obstacles.map.radius': 0.1,
            },
            'obstacles.names',
        ),
    ],
)
def test_cells_that_are_no_map_are_refused(values, where):
    with pytest.raises(ParameterError) as caught:
        guidance_settings(TABLE.resolve(values))
    assert where in {problem.where for problem in caught.value.problems}


def test_a_goal_in_a_wall_is_refused():
    cells = np.zeros((40, 40), np.uint8)
    cells[:, 20] = OCCUPIED
    values = {'map.cells': text_of(cells), 'map.resolution': 0.1, 'road.type': 'none'}
    with pytest.raises(ParameterError, match='obstacle map'):
        guidance_settings(TABLE.resolve({**values, 'goal.position': [2.05, 2.0]}))
    guidance_settings(TABLE.resolve({**values, 'goal.position': [1.0, 2.0]}))


@pytest.mark.parametrize('name', ['warehouse', 'door', 'dead_end'])
def test_the_maps_of_presets_are_what_their_script_draws(name):
    folder = config_directory() / 'maps'
    script = runpy.run_path(str(folder / 'draw.py'))
    drawn = script['shades'](*script[name.upper()])
    grid = read_map(folder / f'{name}.yaml')
    assert np.array_equal(grid.cells == Cell.OCCUPIED, drawn[::-1] == 0)
    assert grid.resolution == script['RESOLUTION']
