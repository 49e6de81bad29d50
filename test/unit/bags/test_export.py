"""Tables for pandas: what is in the bag, with names and units, and nothing overwritten."""

import csv
import math
import shutil
import sys

import pytest
from bag_messages import (
    ARRAY,
    STAMPED,
    TWIST,
    cloud,
    header,
    joints,
    make,
    odometry,
    path,
    pose_stamped,
    raw,
    status,
    twist,
    write_bag,
)
from pyarrow import parquet

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.export import export

THIRD = 1 / 3


def at(stamp, x):
    return odometry(stamp, (x, 2.0, 0.5), (THIRD, -1.0), 'map')


def decision(**values):
    return status('All is "well", so far.', **values)


@pytest.fixture
def write(tmp_path):
    """Write a bag: `write((topic, message), ...)`, a second apart."""

    def write(*records):
        records = [(topic, k * 10**9, message) for k, (topic, message) in enumerate(records, 1)]
        return write_bag(tmp_path / 'bag', records)

    return write


@pytest.fixture
def bag(write):
    return write(
        ('/odom', at(1_500_000_000, THIRD)),
        ('/cmd_vel', twist(1.0, 2.0)),
        ('/stamped', make(STAMPED, header(5), twist(3.0, math.nan))),
        ('/sim/truth', at(2, 1.0)),
        ('/guidance/wheel_speeds', joints(7, (51.0, -THIRD))),
        ('/joint_states', joints(7, (1.0, 2.0, 3.0))),
        (
            '/guidance/decision',
            decision(stamp='5', fallback_level='stop', terminal_error='0.25', own='x'),
        ),
        (
            '/guidance/decision',
            decision(stamp='6', finished='true', terminal_error='nan', step='4', step_ms='1.5'),
        ),
        ('/guidance/predicted_path', path(8, [(0.0, 0.0, 0.0), (1.0, 2.0, -0.5)], stamps=(9, 9))),
        ('/battery', decision(level='low')),
    )


def rows(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def test_csv(bag, tmp_path):
    folder = tmp_path / 'new' / 'tables'
    counts = export(bag, folder)
    assert {path.name: count for path, count in counts.items()} == {
        'odometry.csv': 2,
        'commands.csv': 2,
        'wheel_speeds.csv': 1,
        'decisions.csv': 2,
        'plan.csv': 2,
    }
    assert {each.name for each in folder.iterdir()} == {each.name for each in counts}
    first, second = rows(folder / 'odometry.csv')
    assert (first['topic'], second['topic']) == ('/odom', '/sim/truth')
    assert (first['received [ns]'], first['stamp [ns]']) == ('1000000000', '1500000000')
    assert (first['frame'], float(first['x [m]'])) == ('map', THIRD)
    assert float(first['heading [rad]']) == pytest.approx(0.5)
    assert (float(first['speed [m/s]']), float(first['turn_rate [rad/s]'])) == (THIRD, -1.0)
    plain, stamped = rows(folder / 'commands.csv')
    assert (plain['stamp [ns]'], plain['speed [m/s]'], plain['turn_rate [rad/s]']) == (
        '',
        '1.0',
        '2.0',
    )
    assert (stamped['stamp [ns]'], stamped['turn_rate [rad/s]']) == ('5', 'nan')
    (wheels,) = rows(folder / 'wheel_speeds.csv')
    assert (wheels['right [rad/s]'], float(wheels['left [rad/s]'])) == ('51.0', -THIRD)
    first, second = rows(folder / 'decisions.csv')
    assert (
        first['fallback_level'],
        first['reason'],
        first['terminal_error [m]'],
        first['own'],
    ) == ('stop', 'All is "well", so far.', '0.25', 'x')
    assert (first['finished'], second['finished'], second['step_time [ms]']) == ('', 'True', '1.5')
    points = rows(folder / 'plan.csv')
    assert [(each['point'], each['x [m]'], each['at [ns]']) for each in points] == [
        ('0', '0.0', '9'),
        ('1', '1.0', '9'),
    ]


def test_goals_obstacles_that_move_and_roads(write, tmp_path):
    known = {
        'goal': 'b',
        'goal_x': '0.5',
        'goal_time': '17.0',
        'goals_received': '2',
        'missed': 'true',
    }
    bag = write(
        ('/guidance/decision', decision(stamp='5', **known)),
        ('/goal_pose', pose_stamped(3, (THIRD, 2.0, 0.5), 'map')),
        ('/moving_obstacles', cloud(4, [(7, 1, 2, 0.1, -0.2, 0.3), (8, 3, 4, 0, 0, 0.5)])),
        # What the nodes refuse, a radius below 0, is in no table.
        ('/moving_obstacles', cloud(4, [(9, 1.0, 2.0, 0.1, -0.2, -0.3)])),
        ('/road', path(8, [(0.0, 0.0, 0.0), (1.0, THIRD, 0.0)])),
    )
    folder = tmp_path / 'tables'
    counts = {path.name: count for path, count in export(bag, folder).items()}
    assert counts == {'decisions.csv': 1, 'goals.csv': 1, 'moving.csv': 2, 'road.csv': 2}
    (said,) = rows(folder / 'decisions.csv')
    columns = ('goal', 'goal_x [m]', 'goal_time [s]', 'goals_received', 'missed')
    assert [said[each] for each in columns] == ['b', '0.5', '17.0', '2', 'True']
    (goal,) = rows(folder / 'goals.csv')
    assert (float(goal['x [m]']), goal['frame'], goal['stamp [ns]']) == (THIRD, 'map', '3')
    assert float(goal['heading [rad]']) == pytest.approx(0.5)
    first, second = rows(folder / 'moving.csv')
    assert (first['id'], first['stamp [ns]'], second['radius [m]']) == ('7', '4', '0.5')
    assert (first['vx [m/s]'], first['vy [m/s]']) == ('0.1', '-0.2')
    points = rows(folder / 'road.csv')
    assert [(each['point'], float(each['y [m]'])) for each in points] == [('0', 0.0), ('1', THIRD)]


def test_parquet(bag, tmp_path):
    export(bag, tmp_path / 'tables', 'parquet')
    table = parquet.read_table(tmp_path / 'tables' / 'odometry.parquet')
    assert table.schema.field('x').metadata == {b'unit': b'm'}
    assert table.schema.field('topic').metadata is None
    assert str(table.schema.field('received').type) == 'int64'
    assert table['x'].to_pylist() == [THIRD, 1.0]
    decisions = parquet.read_table(tmp_path / 'tables' / 'decisions.parquet')
    assert decisions['finished'].to_pylist() == [None, True]
    assert decisions['step'].to_pylist() == [None, 4]
    assert decisions['step_time'].to_pylist() == [None, 1.5]
    assert decisions.schema.field('step_time').metadata == {b'unit': b'ms'}
    assert math.isnan(decisions['terminal_error'].to_pylist()[1])


def test_many_rows(tmp_path):
    """More than are held at a time."""
    many, message = 10_002, raw(twist(1.0, 2.0))
    written = write_bag(
        tmp_path / 'many',
        (('/cmd_vel', k, message) for k in range(many)),
        kinds={'/cmd_vel': TWIST},
    )
    assert [*export(written, tmp_path / 'csv').values()] == [many]
    assert [*export(written, tmp_path / 'parquet', 'parquet').values()] == [many]
    table = parquet.read_table(tmp_path / 'parquet' / 'commands.parquet')
    assert table['received'].to_pylist() == list(range(many))
    found = rows(tmp_path / 'csv' / 'commands.csv')
    assert [int(each['received [ns]']) for each in found] == list(range(many))


def test_decisions_in_arrays(write, tmp_path):
    array = make(ARRAY, header(5), [decision(stamp='5', terminal_error='0.25')])
    export(write(('/guidance/decision', array)), tmp_path / 'tables')
    (row,) = rows(tmp_path / 'tables' / 'decisions.csv')
    assert (row['stamp [ns]'], row['terminal_error [m]'], row['reason'][:3]) == ('5', '0.25', 'All')
    empty = ('/guidance/decision', make(ARRAY, header(5), []))
    shutil.rmtree(tmp_path / 'bag')
    with pytest.raises(BagError, match='wanted a decision'):
        export(write(empty), tmp_path / 'new')


@pytest.mark.parametrize(
    ('record', 'reason'),
    [
        (('/battery', decision()), 'no topic that makes a table; there is /battery'),
        (
            ('/guidance/wheel_speeds', joints(7, [1.0])),
            'message of /guidance/wheel_speeds at 1000000000 ns: found 1 wheel speeds',
        ),
        (('/guidance/decision', decision(stamp='x')), 'invalid literal for int'),
        (('/guidance/decision', decision(finished='x')), "'x'"),
        (
            ('/guidance/decision', decision(**{f'k{k}': '' for k in range(999)})),
            'over 200 keys in /guidance/decision',
        ),
    ],
)
def test_what_makes_no_table(write, tmp_path, record, reason):
    with pytest.raises(BagError, match=reason):
        export(write(record), tmp_path / 'tables')


def test_nothing_is_overwritten(bag, tmp_path):
    (tmp_path / 'tables').mkdir()
    with pytest.raises(BagError, match='tables: exists already'):
        export(bag, tmp_path / 'tables')
    assert list((tmp_path / 'tables').iterdir()) == []
    with pytest.raises(BagError, match='cannot write the tables'):
        export(bag, bag / 'metadata.yaml' / 'tables')


def test_without_pyarrow(bag, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    with pytest.raises(BagError, match='Parquet needs pyarrow'):
        export(bag, tmp_path / 'tables', 'parquet')
    assert not (tmp_path / 'tables').exists()
    export(bag, tmp_path / 'tables')
