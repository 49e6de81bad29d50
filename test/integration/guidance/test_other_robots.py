"""Plans of another robot, over DDS: what can be used is known, and the rest is said."""

import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from live import PERIOD_NS
from nav_msgs.msg import Path
from rclpy.time import Time

POSE = (0.0, -9.25, 0.0)
OTHERS = {'odom_timeout': 60.0, 'others.namespaces': ['/r2'], 'others.radius': 0.2}
AWAY = [(20.0, 0.0), (20.1, 0.0)]


def plan(stamp, places, frame_id='odom', step=PERIOD_NS):
    """A message of a plan that was made at a time [ns]."""
    message = Path()
    message.header.frame_id = frame_id
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    for number, (x, y) in enumerate(places):
        pose = PoseStamped()
        pose.header.stamp = Time(nanoseconds=stamp + number * step).to_msg()
        pose.pose.position.x, pose.pose.position.y = x, y
        message.poses.append(pose)
    return message


@pytest.fixture
def tell(client):
    """Publish a plan of /r2: `tell(message)`."""
    return client.teller(Path, '/r2/guidance/predicted_path')


def test_what_cannot_be_used_changes_nothing_and_is_said(
    fault, start_active, client, make_odometry, tell
):
    running = start_active({**OTHERS, 'moving_obstacles.timeout': 50.0})
    begun = client.now()
    tell(plan(begun, AWAY))
    stamp = begun
    for _ in range(50):
        decision, _ = client.decide(make_odometry(stamp, POSE))
        if 'moving_obstacles' in decision:
            break
        stamp += PERIOD_NS
    assert decision['moving_obstacles'] == f'/r2@{begun}'
    now = client.now()
    for bad, reason in (
        (plan(now, AWAY, frame_id='map'), "in frame 'map', wanted 'odom'"),
        (plan(now, [(math.nan, 0.0)]), 'pose 0 at nan, 0 m'),
        (plan(now, AWAY, step=0), 'times that do not increase'),
        (plan(now - 100_000_000_000, AWAY), 's old (moving_obstacles.timeout'),
    ):
        tell(bad)
        health = client.until_health(level=DiagnosticStatus.WARN, said=reason)
        assert 'The plan of /r2' in health['said']
        fault.assert_told(health)
        stamp += PERIOD_NS
        decision, command = client.decide(make_odometry(stamp, POSE))
        assert decision['moving_obstacles'] == f'/r2@{begun}'
        assert (decision['fallback_level'], command[0] > 0.5) == ('nominal', True)
    tell(plan(client.now(), AWAY))
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
    assert '/r2/guidance/predicted_path refused' in running.stderr
    assert 'Traceback' not in running.stderr


def test_plans_that_come_no_more_are_told(fault, start_active, client, make_odometry, tell):
    start_active(OTHERS)
    client.decide(make_odometry(client.now(), POSE))
    assert not any('no plan comes' in each['said'] for each in client.health)
    tell(plan(client.now(), AWAY))
    health = client.until_health(level=DiagnosticStatus.WARN, said='no plan comes: /r2')
    fault.assert_told(health)
    # What it says last is that it stands, and that is so until it says otherwise.
    begun = client.now()
    tell(plan(begun, AWAY[:1]))
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
    decision, _ = client.decide(make_odometry(begun + 10 * PERIOD_NS, POSE))
    assert decision['moving_obstacles'] == f'/r2@{begun}'


def test_a_robot_that_is_stopped_tells_where_it_stands(start_active, client, make_odometry):
    start_active()
    stamp = client.now()
    client.decide(make_odometry(stamp, POSE))
    client.until(lambda: client.paths)
    assert len(client.paths[0].poses) == 51
    assert client.change_state('deactivate')
    client.until(lambda: len(client.paths) > 1)
    (standing,) = client.paths[-1].poses
    first = client.paths[0].poses[0].pose.position
    # It has driven on for as long as the stop has taken.
    assert standing.header.frame_id == 'odom'
    assert standing.header.stamp == client.paths[-1].header.stamp
    assert 0.0 <= standing.pose.position.x - first.x < 2.0
