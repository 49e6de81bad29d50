"""`cmpsp replay --params-file` on a bag of another system: odometry and scans, no decisions."""

import math

import numpy as np
import pytest
from bag_messages import ODOMETRY, SECOND, header, make, odometry, raw
from commands import command
from rosbags.rosbag2 import StoragePlugin, Writer
from scanned_rooms import FIRST, ScannedRoom, straight

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.decision_record import read_decisions
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.guidance.messages import tracks_of

SCAN = 'sensor_msgs/msg/LaserScan'
WALKER = straight(5.0, 1.0, 0.0, 0.8)
LASTS = 40
PARAMETERS = """
/**:
  ros__parameters:
    road.type: none
    goal.position: [9.0, 3.0]
    final_time: 20.0
    robot: {radius: 0.2, max_wheel_speed: 20.0}
    sensors: {names: [front], front: {frame_id: laser}}
"""


def scan(sight, frame_id):
    ranges = np.hypot(*sight.ends.T).astype(np.float32)
    ranges[~sight.hits] = math.inf
    end, step = 0.75 * math.pi, 1.5 * math.pi / (len(ranges) - 1)
    numbers = -end, end, step, 0.0, 0.1, 0.05, 30.0
    return make(SCAN, header(sight.stamp, frame_id), *numbers, ranges, np.zeros(0, np.float32))


@pytest.fixture
def foreign(tmp_path):
    """Record a robot that stands in a room where somebody walks: `foreign(frame_id, topics)`."""

    def foreign(frame_id='laser', topics=('/scan', '/odom')):
        room = ScannedRoom(walkers=[WALKER])
        with Writer(tmp_path / 'bag', version=9, storage_plugin=StoragePlugin.MCAP) as bag:
            kinds = {'/odom': ODOMETRY, '/scan': SCAN}
            there = {
                each: bag.add_connection(each, kinds[each], typestore=jazzy()) for each in topics
            }
            for k in range(LASTS):
                stamp = k * SECOND // 10
                said = {
                    '/scan': scan(room.sight(k / 10.0), frame_id),
                    '/odom': odometry(stamp, room.robot(k / 10.0)),
                }
                for late, topic in enumerate(there, SECOND):
                    bag.write(there[topic], stamp + late, raw(said[topic]))
        (tmp_path / 'robot.yaml').write_text(PARAMETERS)
        return tmp_path / 'bag', '--params-file', tmp_path / 'robot.yaml'

    return foreign


def test_scans_and_odometry_alone_give_tracks_and_decisions_the_same_ones_again(foreign, tmp_path):
    arguments = foreign()
    written = []
    for folder in (tmp_path / 'one', tmp_path / 'other'):
        result = command('replay', *arguments, '--output', folder)
        assert result.exit_code == 0, result.output
        assert result.stdout.startswith('changed: 20 decisions, ')
        assert (folder / 'what_if.png').stat().st_size > 10_000
        with Bag(folder / 'bag') as bag:
            written.append(
                {topic: list(bag.raw(topic)) for topic in bag.topics if 'what_if' in topic}
            )
            decisions = read_decisions(bag, '/what_if/guidance/decision')
            clouds = [message for _, message in bag.messages('/what_if/guidance/tracks')]
    assert [each.stamp for each in decisions] == [k * SECOND // 5 for k in range(20)]
    # Computing times differ.
    assert written[0].keys() == written[1].keys()
    for topic in written[0].keys() - {'/what_if/guidance/decision'}:
        assert written[0][topic] == written[1][topic]
    assert len(clouds) == len(decisions)
    for decision, cloud in list(zip(decisions, clouds, strict=True))[6:]:
        (track,) = tracks_of(cloud, 'odom')
        assert list(decision.tracks) == [(FIRST, decision.stamp)]
        assert math.dist((track.x, track.y), WALKER(decision.stamp / SECOND)) < 0.15


def test_without_parameters_the_message_says_how_to_give_them(foreign):
    result = command('replay', foreign()[0])
    assert result.exit_code == 2
    assert 'no decisions: --params-file makes some' in result.stderr


@pytest.mark.parametrize(
    ('how', 'reason'),
    [
        ({'topics': ('/odom',)}, f'no topic /scan of type {SCAN}; there is /odom'),
        ({'topics': ('/scan',)}, f'no topic /odom of type {ODOMETRY}; there is /scan'),
        ({'frame_id': 'lidar'}, "/scan: front: frame_id: found 'lidar', wanted 'laser'"),
    ],
)
def test_what_is_missing_is_named(foreign, how, reason):
    arguments = foreign(**how)
    result = command('replay', *arguments)
    assert result.exit_code == 2
    assert reason in ' '.join(result.stderr.split())
    assert not arguments[0].with_name('bag_what_if').exists()
