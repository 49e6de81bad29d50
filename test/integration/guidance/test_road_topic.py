"""Roads that are told to the guidance node under way: waited for, taken, refused, replayed."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live import LATCHED, PERIOD_NS
from nav_msgs.msg import Path as PathMessage

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.audit import CheckOutcome, audit
from cmpsp_ros.nodes.common.messages import path_of
from cmpsp_ros.robots.motion import arc_ends

START = (0.0, -10.0, 0.0)

# Odometry is stamped ahead of time here, and the test may be slow between two messages.
TOLD = {
    'road.type': 'corridor', 'road.source': 'topic', 'odom_timeout': 60.0, 'final_time': 20.0,
}  # fmt: skip


def ring(radius, *, frame_id='odom', corners=40):
    """A road between two circles, nearly."""
    angles = [math.tau * k / corners for k in range(corners)]
    numbers = [radius * each for a in angles for each in (math.cos(a), math.sin(a))]
    return path_of({'road.points': numbers, 'road.closed': True, 'frame_id': frame_id})


def back_and_forth():
    return path_of(
        {'road.points': [0.0, 0.0, 3.0, 0.0, 1.0, 0.0], 'road.closed': False, 'frame_id': 'odom'}
    )


def not_finite():
    road = ring(10.0)
    road.poses[3].pose.position.x = math.nan
    return road


REFUSED = (
    (ring(10.0, frame_id='map'), "found frame 'map', wanted 'odom' (frame_id)"),
    (not_finite(), 'road, point 3 (from 0): found [nan, '),
    (back_and_forth(), 'road.points: found at point 1 (from 0) a turn back by 180 deg'),
    (ring(20.0), 'goal.position: found'),
    (PathMessage(header=ring(10.0).header), 'road: found 0 points'),
)


@pytest.fixture
def tell(client):
    """Tell of a road: `tell(message)`."""
    return client.teller(PathMessage, 'road', LATCHED)


def test_a_road_is_waited_for_and_a_bad_one_refused(fault, start_node, client, make_odometry, tell):
    running = start_node('guidance_node', TOLD)
    client.connect()
    health = client.until_health(state='active', said='Waiting for a road on the topic road')
    fault.assert_told(health)
    client.until(lambda: 'Waiting for a road on the topic road.' in running.stderr)
    stamp = client.now()
    for message, reason in REFUSED:
        tell(message)
        health = client.until_health(level=DiagnosticStatus.ERROR, said=reason)
        fault.assert_told(health)
        client.until(lambda reason=reason: reason in running.stderr)
        stamp += PERIOD_NS
        client.send(stamp, START)
        # Heard by then, and no drive has come of it.
        client.until_health(level=DiagnosticStatus.ERROR, said=reason)
    assert (client.decisions, client.commands) == ([], [])
    tell(ring(10.0))
    client.until_health(level=DiagnosticStatus.WARN, said='Waiting for odometry')
    decision, command = client.decide(make_odometry(stamp + PERIOD_NS, START))
    assert (decision['fallback_level'], decision['step'], command[0] > 0.5) == (
        'nominal',
        '0',
        True,
    )
    # One that is refused under way leaves the old road.
    tell(REFUSED[2][0])
    client.until_health(level=DiagnosticStatus.ERROR, said=REFUSED[2][1])
    after, _ = client.decide(make_odometry(stamp + 2 * PERIOD_NS, START))
    assert (after['fallback_level'], after['revision']) == ('nominal', decision['revision'])
    outcome = client.set_parameter('road.points', [])
    assert not outcome.successful
    assert 'road.points' in outcome.reason
    tell(ring(10.1))
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
    later, _ = client.decide(make_odometry(stamp + 3 * PERIOD_NS, START))
    assert int(later['revision']) == int(decision['revision']) + 1
    assert 'Traceback' not in running.stderr


def test_a_drive_on_roads_that_change_is_replayed_and_audited(
    start_active, client, record, make_odometry, tell
):
    recording = record()
    running = start_active(TOLD)
    recording.until_all_is_heard()
    pose, stamp, edges = np.array(START), client.now(), []
    for step in range(30):
        if step in (0, 10, 20):
            come = running.stderr.count('a road of 41 points has come')
            tell(ring(10.0 + 0.002 * step))
            client.until(lambda come=come: running.stderr.count('has come') > come)
        decision, command = client.decide(make_odometry(stamp, pose))
        assert decision['fallback_level'] == 'nominal', decision
        edges.append(int(decision['revision']))
        pose = arc_ends(pose[None], np.array([command]), np.array([0.2]))[0]
        stamp += PERIOD_NS
    assert sorted(set(edges)) == [edges[0], edges[0] + 1, edges[0] + 2]
    assert recording.replayed().decisions == 30
    with Bag(recording.bag) as opened:
        assert opened.topics['/road'].count == 3
    found = {each.check: each.outcome for each in audit(recording.bag)}
    assert found['road'] is CheckOutcome.PASSED
