"""Maps of map_server become parameters, and what is no map is refused with the key at fault."""

import json
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
from cmpsp_ros.parameters.files.course_files import read_map, with_map_file, with_road_file
from cmpsp_ros.parameters.obstacles import map_of
from cmpsp_ros.parameters.roads import road_of
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


LINE = [[0.0, 0.0], [3.0, 0.5], [6.0, 0.0]]
RING = [[5.0, 0.0], [0.0, 5.0], [-5.0, 0.0], [0.0, -5.0], [5.0, 0.0]]


def read(tmp_path, text, name='road.csv'):
    path = tmp_path / name
    path.write_text(text if isinstance(text, str) else json.dumps(text))
    return with_road_file({'road.file': str(path), 'road.half_width': [0.7], 'final_time': 9.0})


def feature(coordinates, **properties):
    geometry = {'type': 'LineString', 'coordinates': coordinates}
    return {'type': 'Feature', 'geometry': geometry, 'properties': properties}


def test_without_a_file_nothing_changes():
    assert with_road_file({'final_time': 9.0}) == {'final_time': 9.0}


def test_csv_of_points_leaves_the_width_that_is_given(tmp_path):
    found = read(tmp_path, 'x,y\n0,0\n3, 0.5\n\n6,0\n')
    assert found == {
        'road.type': 'corridor', 'road.points': [0.0, 0.0, 3.0, 0.5, 6.0, 0.0],
        'road.closed': False, 'road.half_width': [0.7], 'final_time': 9.0,
    }  # fmt: skip
    assert road_of(TABLE.resolve(found)).left == (0.7, 0.7, 0.7)


def test_csv_with_widths(tmp_path):
    found = read(tmp_path, '\ufeffleft_width,x,y,right_width\n1,0,0,2\n1.5,3,0.5,2\n1,6,0,1\n')
    assert 'road.half_width' not in found
    road = road_of(TABLE.resolve(found))
    assert (road.left, road.right) == ((1.0, 1.5, 1.0), (2.0, 2.0, 1.0))


@pytest.mark.parametrize('name', ['road.geojson', 'road.JSON'])
def test_geojson_that_comes_back_is_closed(tmp_path, name):
    widths = [0.5, 0.6, 0.7, 0.8, 0.5]
    collection = {'type': 'FeatureCollection', 'features': [feature(RING, half_width=widths)]}
    road = road_of(TABLE.resolve(read(tmp_path, collection, name)))
    assert road.closed
    assert road.points == tuple(map(tuple, RING[:-1]))
    assert road.left == (0.5, 0.6, 0.7, 0.8)


def test_geojson_with_one_width_or_none(tmp_path):
    assert read(tmp_path, feature(LINE, half_width=0.4), 'a.geojson')['road.half_width'] == [0.4]
    bare = {'type': 'LineString', 'coordinates': LINE}
    assert read(tmp_path, bare, 'b.geojson')['road.half_width'] == [0.7]


@pytest.mark.parametrize(
    ('name', 'text', 'said'),
    [
        ('road.csv', '', 'road.csv, line 1: found'),
        ('road.csv', '0,0\n1,1\n', 'line 1: found .* wanted a first line with x, y'),
        ('road.csv', 'x,y,z\n0,0,0\n', 'line 1: found'),
        ('road.csv', 'x,y,x\n0,0,0\n', 'line 1: found'),
        ('road.csv', 'x,y\n0,0\n\n1\n', 'line 4: found .*, wanted 2 finite numbers'),
        ('road.csv', 'x,y\n0,nan\n', 'line 2: found .*, wanted 2 finite numbers'),
        ('road.csv', 'x,y\n0,zero\n', 'line 2: found .*, wanted 2 finite numbers'),
        ('road.geojson', '{', 'no JSON'),
        ('road.geojson', '[' * 100_000, 'no JSON'),
        ('road.geojson', '3', 'found 0 LineStrings'),
        ('road.geojson', [], 'found 0 LineStrings'),
        ('road.geojson', {'type': 'FeatureCollection', 'features': 3}, 'found 0 LineStrings'),
        (
            'road.geojson',
            {'type': 'FeatureCollection', 'features': [feature(LINE), feature(RING)]},
            'found 2 LineStrings, wanted one',
        ),
        ('road.geojson', feature([[0.0, 0.0], [1.0]]), r'point 1: found \[1.0\]'),
        ('road.geojson', feature([[0.0, True]]), 'point 0: found'),
        ('road.geojson', feature('points'), 'point 0: found nothing'),
        ('road.txt', 'x,y\n', r'road.file: found .*, wanted a file named \*.csv'),
    ],
)
def test_what_is_no_road_is_refused(tmp_path, name, text, said):
    with pytest.raises(ParameterError, match=said):
        read(tmp_path, text, name)


def test_a_file_that_is_not_there_or_is_not_text(tmp_path):
    with pytest.raises(ParameterError, match='No such file'):
        with_road_file({'road.file': str(tmp_path / 'none.csv')})
    (tmp_path / 'odd.csv').write_bytes(b'\xff\xfe\xff')
    with pytest.raises(ParameterError, match='wanted a file that can be read'):
        with_road_file({'road.file': str(tmp_path / 'odd.csv')})
    (tmp_path / 'large.csv').write_bytes(b' ' * 10_000_001)
    with pytest.raises(ParameterError, match='a larger file'):
        with_road_file({'road.file': str(tmp_path / 'large.csv')})


def test_widths_that_are_none_are_refused_as_parameters_are(tmp_path):
    found = read(tmp_path, feature(LINE, half_width='wide'), 'a.geojson')
    with pytest.raises(ParameterError, match=r'road\.half_width: found'):
        TABLE.resolve(found)


def test_a_parameter_file_may_name_one_and_nothing_else_may(tmp_path):
    (tmp_path / 'line.csv').write_text('x,y\n0,0\n3,0.5\n6,0\n')
    text = f'/**:\n  ros__parameters:\n    road:\n      file: {tmp_path / "line.csv"}\n'
    (tmp_path / 'mine.yaml').write_text(text)
    values = TABLE.resolve(load_parameter_file(tmp_path / 'mine.yaml'))
    assert values['road.points'] == [0.0, 0.0, 3.0, 0.5, 6.0, 0.0]
    # What a bag says goes straight to the table.
    with pytest.raises(ParameterError, match=r'road\.file: found an unknown'):
        TABLE.resolve({'road.file': str(tmp_path / 'line.csv')})


def test_a_map_that_is_not_there_is_named_with_its_parameter_and_where_it_was_looked_for(tmp_path):
    with pytest.raises(ParameterError) as refused:
        with_map_file({'map.file': 'none.yaml'}, tmp_path)
    said = str(refused.value)
    assert said.startswith('map.file: found no file ')
    assert str(tmp_path / 'none.yaml') in said
