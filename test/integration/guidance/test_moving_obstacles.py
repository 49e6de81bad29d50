"""Obstacles that move, over DDS: what is told of well is known, and the rest changes nothing."""

import math
from dataclasses import replace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live import PERIOD_NS
from sensor_msgs.msg import PointCloud2

from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.nodes.common.messages import cloud_of

POSE = (0.0, -9.25, 0.0)
ROOM = {'odom_timeout': 60.0, 'moving_obstacles.capacity': 2, 'moving_obstacles.timeout': 50.0}


@pytest.fixture
def tell(client):
    """Tell of obstacles as they are in a frame: `tell(tracks, frame_id='odom')`."""
    send = client.teller(PointCloud2, 'moving_obstacles')
    return lambda tracks, frame_id='odom': send(cloud_of(tracks, tracks[0].stamp, frame_id))


def test_what_cannot_be_used_changes_nothing_and_is_said(
    fault, start_active, client, make_odometry, tell
):
    running = start_active(ROOM)
    stamp = client.now()
    decision, _ = client.decide(make_odometry(stamp, POSE))
    assert 'moving_obstacles' not in decision
    far = Track(3, stamp, 0.3, 20.0, 0.0, 0.1, 0.0)
    tell([far])
    # Heard when it is known to a decision.
    known = f'3@{stamp}'
    for _ in range(20):
        stamp += PERIOD_NS
        decision, _ = client.decide(make_odometry(stamp, POSE))
        if decision.get('moving_obstacles') == known:
            break
    assert decision['moving_obstacles'] == known
    for bad, frame_id, reason in (
        (replace(far, x=math.nan), 'odom', 'not finite'),
        (replace(far, radius=-1.0), 'odom', 'a radius of -1 m, wanted 0 or more'),
        (far, 'map', "in frame 'map', wanted 'odom'"),
        (replace(far, stamp=far.stamp - 100_000_000_000), 'odom', 's old (moving_obstacles'),
    ):
        tell([bad], frame_id)
        health = client.until_health(level=DiagnosticStatus.WARN, said=reason)
        fault.assert_told(health)
        stamp += PERIOD_NS
        decision, command = client.decide(make_odometry(stamp, POSE))
        assert decision['moving_obstacles'] == known
        assert (decision['fallback_level'], command[0] > 0.5) == ('nominal', True)
    tell([replace(far, stamp=client.now())])
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
    assert 'Traceback' not in running.stderr
    assert 'moving_obstacles refused' in running.stderr


def test_nothing_is_listened_to_without_capacity(start_active, client):
    start_active()
    assert client.node.count_subscribers('/moving_obstacles') == 0
