"""Messages in other frames than the course's: led there by a real publisher of `/tf`.

The course is in `map`; odometry is of `base_footprint` in `odom`, which drifts in `map`, and the
robot's centre, `base_link`, is beside it.
"""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from live import LATCHED, PERIOD_NS, pose_stamped, transform
from sensor_msgs.msg import PointCloud2

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.audit import CheckOutcome, audit
from cmpsp_ros.bags.report import write_report
from cmpsp_ros.bags.runs.run import driven_in
from cmpsp_ros.guidance.messages import Track, compose
from cmpsp_ros.nodes.common.messages import cloud_of
from cmpsp_ros.robots.motion import arc_ends

pytestmark = pytest.mark.timeout(300)

START = np.array([0.0, -9.25, 0.0])
CENTER = np.array([0.1, -0.05, 0.4])
PARAMETERS = {'frame_id': 'map', 'robot_frame': 'base_link'}


def back(pose):
    """The frame in which a pose is that of, by the pose."""
    there = compose(np.array([0.0, 0.0, -pose[2]]), np.array([-pose[0], -pose[1], 0.0]))
    return np.array([there[0], there[1], -pose[2]])


class Localisation:
    """Publishes transforms, and odometry that fits them."""

    def __init__(self, client):
        from tf2_msgs.msg import TFMessage

        self.client, self.begun, self.message = client, client.now(), TFMessage
        self.moving = client.node.create_publisher(TFMessage, '/tf', 100)
        static = client.node.create_publisher(TFMessage, '/tf_static', LATCHED)
        static.publish(TFMessage(transforms=[transform('base_footprint', 'base_link', CENTER)]))

    def drift(self, stamp):
        """Pose of `odom` in `map`."""
        seconds = (stamp - self.begun) / 1e9
        return np.array([3.0 + 0.02 * seconds, -2.0, 0.7 + 0.01 * seconds])

    def locate(self, stamp):
        moved = transform('map', 'odom', self.drift(stamp), stamp)
        self.moving.publish(self.message(transforms=[moved]))

    def odometry(self, make_odometry, stamp, pose):
        """Odometry by which the robot's centre is at a pose of the map."""
        footprint = compose(compose(back(self.drift(stamp)), pose), back(CENTER))
        message = make_odometry(stamp, footprint, 'odom')
        message.child_frame_id = 'base_footprint'
        return message


@pytest.fixture
def localisation(interfaces, client):
    interfaces('tf2_msgs')
    return Localisation(client)


def test_a_run_reaches_its_goal_and_is_replayed_and_audited_without_transforms(
    localisation, start_node, record, client, make_odometry, tmp_path
):
    clock, recording = client.node.get_clock(), record('exclude_topics:=[/tf, /tf_static]')
    patient = {'recorder_timeout': 60.0, 'odom_timeout': 10.0}
    guidance = start_node('guidance_node', {**PARAMETERS, **patient})
    client.until_health(state='active')
    client.connect()
    client.until(localisation.moving.get_subscription_count)
    pose, driven_to, passed = START, clock.now().nanoseconds, []

    def tick():
        nonlocal pose, driven_to
        now = clock.now().nanoseconds
        twist = np.array([client.commands[-1] if client.commands else (0.0, 0.0)])
        pose, driven_to = arc_ends(pose[None], twist, np.array([(now - driven_to) / 1e9]))[0], now
        passed.append(pose)
        localisation.locate(now)
        client.odometry.publish(localisation.odometry(make_odometry, now, pose))

    client.node.create_timer(0.02, tick)
    client.until(lambda: client.decisions and client.decisions[-1]['finished'] == 'true')
    assert math.dist(pose[:2], (10.0, 0.0)) < 0.05
    assert client.decisions[-1]['missed'] == 'false'
    count = len(passed)
    client.until(lambda: len(passed) > count + 20)
    guidance.end()
    assert recording.replayed().decisions > 50
    found = {each.check: each.outcome for each in audit(recording.bag)}
    for check in ('obstacles', 'road', 'goal', 'obeyed', 'as_decided'):
        assert found[check] is CheckOutcome.PASSED, (check, found)
    with Bag(recording.bag) as bag:
        driven = driven_in(bag, '').poses
    away = np.hypot(*(driven[:, None, :2] - np.array(passed)[None, :, :2]).transpose(2, 0, 1))
    assert away.min(axis=1).max() < 1e-9
    write_report([recording.bag], tmp_path / 'report.html')


def test_goals_and_obstacles_of_other_frames_are_led_to_that_of_the_course(
    localisation, start_node, client, make_odometry
):
    more = {'odom_timeout': 60.0, 'moving_obstacles.capacity': 2}
    running = start_node('guidance_node', {**PARAMETERS, **more})
    client.until_health(state='active')
    goals = client.node.create_publisher(PoseStamped, 'goal_pose', 10)
    obstacles = client.node.create_publisher(PointCloud2, 'moving_obstacles', 10)
    told = []
    client.node.create_subscription(PointCloud2, '/guidance/moving_obstacles', told.append, 10)
    for each in (goals, obstacles, localisation.moving):
        client.until(each.get_subscription_count)
    client.connect()
    stamp = client.now()
    # Without a transform the robot is not moved, and nothing is believed.
    decision, command = client.decide(localisation.odometry(make_odometry, stamp, START))
    assert command == (0.0, 0.0)
    assert (
        "wanted 'map' (frame_id): no transform from 'odom' to 'map' has come" in decision['reason']
    )
    goals.publish(pose_stamped(stamp, 'odom', (1.0, 1.0, 0.0)))
    client.until(lambda: "goal_pose is refused: The goal is in frame 'odom'" in running.stderr)
    client.until_health(level=DiagnosticStatus.ERROR, fallback_level='stop')

    def step(condition=lambda decision: True):
        nonlocal stamp
        stamp += PERIOD_NS
        localisation.locate(stamp)
        message = localisation.odometry(make_odometry, stamp, START)
        return client.decide(message, condition)[0]

    localisation.locate(stamp)
    # What is published first may be heard last: a step or two are taken meanwhile.
    decision = step()
    while decision['fallback_level'] == 'stop':
        decision = step()
    np.testing.assert_allclose([float(each) for each in decision['pose'].split()], START, atol=1e-9)

    wanted = np.array([7.0, -7.0, 0.8])
    there = compose(back(localisation.drift(stamp)), wanted).tolist()
    goals.publish(pose_stamped(stamp, 'odom', there))
    while 'goals_received' not in decision:
        decision = step()
    assert decision['goals_received'] == '1'
    found = [float(decision[key]) for key in ('goal_x', 'goal_y', 'goal_heading')]
    np.testing.assert_allclose(found, wanted, atol=1e-9)

    x, y, _ = compose(back(localisation.drift(stamp)), np.array([20.0, 1.0, 0.0])).tolist()
    seen = Track(3, stamp, 0.3, x, y, 0.5, 0.0)
    obstacles.publish(cloud_of([seen], stamp, 'odom'))
    while 'moving_obstacles' not in decision:
        decision = step()
    assert decision['moving_obstacles'] == f'3@{stamp}' or int(decision['stamp']) > seen.stamp
    (cloud,) = told
    assert cloud.header.frame_id == 'map'
    assert 'Traceback' not in running.stderr
