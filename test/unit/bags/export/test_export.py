"""Tables for pandas: what is in the bag, with names and units, and nothing overwritten."""

from __future__ import annotations

import csv
import math
import struct
import sys

import numpy as np
import pytest
from pyarrow import parquet

from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.export.files import export
from cmpsp_ros.bags.writer import BagWriter
from cmpsp_ros.guidance.messages.tracks import FLOATS

THIRD = 1 / 3
ODOMETRY = 'nav_msgs/msg/Odometry'
TWIST = 'geometry_msgs/msg/Twist'
STAMPED = 'geometry_msgs/msg/TwistStamped'
JOINTS = 'sensor_msgs/msg/JointState'
STATUS = 'diagnostic_msgs/msg/DiagnosticStatus'
PATH = 'nav_msgs/msg/Path'
CLOUD = 'sensor_msgs/msg/PointCloud2'
POSE = 'geometry_msgs/msg/PoseStamped'


def make(name, *args):
    return jazzy().types[name](*args)


def header(stamp):
    return make(
        'std_msgs/msg/Header',
        make('builtin_interfaces/msg/Time', *divmod(stamp, 10**9)),
        'map',
    )


def pose(x, y, heading):
    half = heading / 2
    return make(
        'geometry_msgs/msg/Pose',
        make('geometry_msgs/msg/Point', x, y, 0.0),
        make('geometry_msgs/msg/Quaternion', 0.0, 0.0, math.sin(half), math.cos(half)),
    )


def twist(speed, turn_rate):
    linear, angular = (speed, 0.0, 0.0), (0.0, 0.0, turn_rate)
    return make(TWIST, *(make('geometry_msgs/msg/Vector3', *each) for each in (linear, angular)))


def odometry(stamp, x):
    zeros = np.zeros(36)
    return make(
        ODOMETRY,
        header(stamp),
        'base_link',
        make('geometry_msgs/msg/PoseWithCovariance', pose(x, 2.0, 0.5), zeros),
        make('geometry_msgs/msg/TwistWithCovariance', twist(THIRD, -1.0), zeros),
    )


def joints(*speeds):
    none = np.zeros(0)
    return make(JOINTS, header(7), ['r', 'l'], none, np.array(speeds), none)


def decision(**values):
    pairs = [make('diagnostic_msgs/msg/KeyValue', *each) for each in values.items()]
    return make(STATUS, 0, 'guidance', 'All is "well", so far.', '', pairs)


def plan(*points):
    poses = [make('geometry_msgs/msg/PoseStamped', header(9), pose(*each)) for each in points]
    return make(PATH, header(8), poses)


def cloud(*points):
    """Obstacles that move: (id, x, y, vx, vy, radius) each."""
    field = jazzy().types['sensor_msgs/msg/PointField']
    fields = [field(name, 8 * place, 8, 1) for place, name in enumerate(FLOATS)]
    data = b''.join(struct.pack('<5di', *values, number) for number, *values in points)
    size = len(points)
    return make(
        CLOUD, header(4), 1, size, [*fields, field('id', 40, 5, 1)], False, 44, 44 * size,
        np.frombuffer(data, np.uint8), True,
    )  # fmt: skip


def goal_pose(*place):
    return make(POSE, header(3), pose(*place))


@pytest.fixture
def write(tmp_path):
    """Write a bag: `write((topic, type, message), ...)`, a second apart."""

    def write(*records):
        with BagWriter(tmp_path / 'bag') as bag:
            for stamp, (topic, name, message) in enumerate(records, 1):
                if not any(topic == each for each, _, _ in records[: stamp - 1]):
                    bag.topic(topic, name)
                bag.write(topic, stamp * 10**9, bytes(jazzy().serialize_cdr(message, name)))
        return tmp_path / 'bag'

    return write


@pytest.fixture
def bag(write):
    return write(
        ('/odom', ODOMETRY, odometry(1_500_000_000, THIRD)),
        ('/cmd_vel', TWIST, twist(1.0, 2.0)),
        ('/stamped', STAMPED, make(STAMPED, header(5), twist(3.0, math.nan))),
        ('/sim/truth', ODOMETRY, odometry(2, 1.0)),
        ('/guidance/wheel_speeds', JOINTS, joints(51.0, -THIRD)),
        ('/joint_states', JOINTS, joints(1.0, 2.0, 3.0)),
        ('/guidance/decision', STATUS, decision(stamp='5', rung='stop', miss='0.25', own='x')),
        (
            '/guidance/decision',
            STATUS,
            decision(stamp='6', finished='true', miss='nan', step='4', step_ms='1.5'),
        ),
        ('/guidance/predicted_path', PATH, plan((0.0, 0.0, 0.0), (1.0, 2.0, -0.5))),
        ('/battery', STATUS, decision(level='low')),
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
    assert (first['rung'], first['reason'], first['miss [m]'], first['own']) == (
        'stop',
        'All is "well", so far.',
        '0.25',
        'x',
    )
    assert (first['finished'], second['finished'], second['step_time [ms]']) == ('', 'True', '1.5')
    points = rows(folder / 'plan.csv')
    assert [(each['point'], each['x [m]'], each['at [ns]']) for each in points] == [
        ('0', '0.0', '9'),
        ('1', '1.0', '9'),
    ]


def test_goals_obstacles_that_move_and_roads(write, tmp_path):
    known = {'goal': 'b', 'goal_x': '0.5', 'goal_time': '17.0', 'told': '2', 'missed': 'true'}
    bag = write(
        ('/guidance/decision', STATUS, decision(stamp='5', **known)),
        ('/goal_pose', POSE, goal_pose(THIRD, 2.0, 0.5)),
        ('/moving_obstacles', CLOUD, cloud((7, 1.0, 2.0, 0.1, -0.2, 0.3), (8, 3, 4, 0, 0, 0.5))),
        # What the nodes refuse, a radius below 0, is in no table.
        ('/moving_obstacles', CLOUD, cloud((9, 1.0, 2.0, 0.1, -0.2, -0.3))),
        ('/road', PATH, plan((0.0, 0.0, 0.0), (1.0, THIRD, 0.0))),
    )
    folder = tmp_path / 'tables'
    counts = {path.name: count for path, count in export(bag, folder).items()}
    assert counts == {'decisions.csv': 1, 'goals.csv': 1, 'moving.csv': 2, 'road.csv': 2}
    (said,) = rows(folder / 'decisions.csv')
    columns = ('goal', 'goal_x [m]', 'goal_time [s]', 'told', 'missed')
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
    assert math.isnan(decisions['miss'].to_pylist()[1])


def test_many_rows(write, tmp_path, monkeypatch):
    monkeypatch.setattr('cmpsp_ros.bags.export.files._BATCH', 3)
    path = write(*(('/odom', ODOMETRY, odometry(stamp, float(stamp))) for stamp in range(10)))
    assert [*export(path, tmp_path / 'csv').values()] == [10]
    assert [*export(path, tmp_path / 'parquet', 'parquet').values()] == [10]
    table = parquet.read_table(tmp_path / 'parquet' / 'odometry.parquet')
    assert table['x'].to_pylist() == [float(each) for each in range(10)]
    assert [float(each['x [m]']) for each in rows(tmp_path / 'csv' / 'odometry.csv')] == [
        float(each) for each in range(10)
    ]


@pytest.mark.parametrize(
    ('record', 'reason'),
    [
        (('/battery', STATUS, decision()), 'no topic that makes a table; there is /battery'),
        (
            ('/guidance/wheel_speeds', JOINTS, joints(1.0)),
            'message of /guidance/wheel_speeds at 1000000000 ns: found 1 wheel speeds',
        ),
        (('/guidance/decision', STATUS, decision(stamp='x')), 'invalid literal for int'),
        (('/guidance/decision', STATUS, decision(finished='x')), "'x'"),
        (
            ('/guidance/decision', STATUS, decision(**{f'k{k}': '' for k in range(999)})),
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
