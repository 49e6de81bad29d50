"""Roads from files."""

import json

import pytest

from cmpsp_ros.parameters import TABLE, ParameterError, load_parameter_file
from cmpsp_ros.parameters.files.road_files import with_road_file
from cmpsp_ros.parameters.roads import road_of

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
