"""The simulator sees: scans over DDS at their rate, and the same again after a reset."""

import math
import signal
import sys

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosbags.interfaces import QosDurability
from sensor_msgs.msg import LaserScan, PointCloud2
from sim_client import BEST_EFFORT, Client, stamp, twist

from cmpsp_ros.bags import Bag
from cmpsp_ros.guidance.messages import tracks_of

COURSE = {
    'initial_pose': [0.0, 0.0, 0.0],
    'road.type': 'none',
    'sim.scan.rate': 10.0,
    'sim.scan.pose': [0.1, 0.0, 0.0],
    'sim.scan.count': 181,
    'sim.scan.angle_min': -math.pi / 2.0,
    'sim.scan.angle_max': math.pi / 2.0,
    'sim.scan.stddev': 0.01,
    'sim.scan.dropout': 0.1,
    'sim.obstacles.names': '[wall]',
    'sim.obstacles.wall.type': 'capsule',
    'sim.obstacles.wall.start': [2.1, -3.0],
    'sim.obstacles.wall.end': [2.1, 3.0],
    'sim.obstacles.wall.radius': 0.1,
    'moving_obstacles.names': '[cart]',
    'moving_obstacles.cart.center': [0.1, -1.5],
    'moving_obstacles.cart.velocity': [0.0, 0.5],
    'moving_obstacles.cart.radius': 0.3,
}


class Listener(Client):
    """Hears scans as well, as a node for sensor data does."""

    def __init__(self, ros):
        super().__init__(ros)
        self.scans = []
        self.node.create_subscription(LaserScan, 'scan', self.scans.append, BEST_EFFORT)


def test_what_surrounds_it_is_seen_at_its_rate(simulate, ros):
    simulate(COURSE)
    client = Listener(ros)
    client.until(lambda: len(client.scans) >= 5)
    first = client.scans[0]
    assert first.header.frame_id == 'base_scan'
    assert (len(first.ranges), first.range_max) == (181, 8.0)
    assert first.angle_min + 180 * first.angle_increment == pytest.approx(first.angle_max)
    assert np.diff([stamp(each) for each in client.scans]).tolist() == [100_000_000] * 4
    ranges = np.array([each.ranges for each in client.scans])
    assert 0 < np.isnan(ranges).sum() < 0.2 * ranges.size
    # The cart on the right, the wall ahead, nothing on the left.
    assert np.nanmedian(ranges[:, 0]) == pytest.approx(1.2, abs=0.05)
    assert np.nanmedian(ranges[:, 85:95]) == pytest.approx(1.9, abs=0.05)
    assert np.nanmin(ranges[:, -5:]) == math.inf


def test_in_lockstep_none_is_missing_and_a_reset_begins_the_same_again(simulate, ros):
    simulate({**COURSE, 'publish_clock': 'true', 'lockstep': 'true'})
    client = Listener(ros)
    client.answer, client.steps_left = (lambda _k: twist(0.3)), 10
    client.until(lambda: client.steps_left == 0)
    # What was not heard at first is published again, as odometry is.
    expected = set(range(0, 2_000_000_001, 100_000_000))
    client.until(lambda: {stamp(each) for each in client.scans} == expected)
    first = next(each.ranges for each in client.scans if stamp(each) == 0)
    assert client.reset()
    client.until(lambda: np.array_equal(client.scans[-1].ranges, first, equal_nan=True))
    assert stamp(client.scans[-1]) == 2_000_000_000


def test_people_are_seen_and_told_to_judges_and_begin_with_the_first_command(simulate, ros):
    simulate(
        {
            **COURSE,
            'sim.people.names': '[ann]',
            'sim.people.ann.position': [1.0, 0.0],
            'sim.people.ann.heading': math.pi / 2.0,
            'sim.people.ann.gives_way': 'false',
        }
    )
    client, clouds = Listener(ros), []
    client.node.create_subscription(PointCloud2, 'sim/people', clouds.append, 10)
    client.until(lambda: clouds and len(client.scans) >= 3)
    ahead = np.array(client.scans[-1].ranges)[85:95]
    assert np.nanmedian(ahead) == pytest.approx(0.65, abs=0.05)
    (ann,) = tracks_of(clouds[-1], 'odom')
    assert (ann.x, ann.y, ann.vx, ann.vy, ann.radius) == (1.0, 0.0, 0.0, 0.0, 0.25)
    client.send(twist(0.0))
    client.until(lambda: tracks_of(clouds[-1], 'odom')[0].y > 0.6)
    count = len(client.scans)
    client.until(lambda: len(client.scans) > count + 1)
    assert np.nanmedian(np.array(client.scans[-1].ranges)[85:95]) > 1.5


def test_where_the_scanner_is_is_published_once_for_all_who_come_later(
    interfaces, simulate, spawn, ros, tmp_path
):
    interfaces('tf2_msgs')
    from tf2_msgs.msg import TFMessage

    simulate(COURSE)
    client, moving, static = Listener(ros), [], []
    client.until(lambda: len(client.odometry) > 20)
    ros.node.create_subscription(TFMessage, '/tf', moving.append, 100)
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    ros.node.create_subscription(TFMessage, '/tf_static', static.append, latched)
    client.until(lambda: len(moving) > 20 and static)

    ((there,),) = (each.transforms for each in static)
    assert (there.header.frame_id, there.child_frame_id) == ('base_link', 'base_scan')
    assert there.transform.translation.x == 0.1
    assert {each.child_frame_id for message in moving for each in message.transforms} == {
        'base_link'
    }

    bag, command = tmp_path / 'bag', 'cmpsp_ros.nodes.recording.recorder'
    given = (f'output:={bag}', 'own_topics:=true')
    flags = [flag for each in given for flag in ('-p', each)]
    recorder = spawn([sys.executable, '-m', command, '--ros-args', *flags])
    hears = client.node.get_subscriptions_info_by_topic
    client.until(lambda: 'recorder' in {each.node_name for each in hears('/tf_static')})
    count = len(moving)
    client.until(lambda: len(moving) > count + 20)
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    with Bag(bag) as recorded:
        topic = recorded.topics['/tf_static']
        ((_, message),) = recorded.messages('/tf_static')
        assert recorded.topics['/tf'].count > 10
    assert message.transforms[0].child_frame_id == 'base_scan'
    assert {each.durability for each in topic.qos_profiles} == {QosDurability.TRANSIENT_LOCAL}
