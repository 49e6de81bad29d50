"""A run begins when the robot listens, and the recorder where one is asked for."""

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TwistStamped
from rclpy.qos import DurabilityPolicy, QoSProfile

from cmpsp_ros.nodes.common.topics import DECISION

pytestmark = pytest.mark.integration


def test_without_a_listener_of_its_type_the_time_does_not_run(fault, start_node, make_client):
    client = make_client(kind=TwistStamped)
    start_node()
    client.until(client.odometry.get_subscription_count)
    client.drive()
    health = client.until_health(state='active', said='enable_stamped_cmd_vel')
    assert health['level'] == DiagnosticStatus.WARN
    assert health['said'] == (
        'Waiting for a listener to /cmd_vel (geometry_msgs/msg/Twist).'
        ' Another listener wants geometry_msgs/msg/TwistStamped: enable_stamped_cmd_vel.'
    )
    fault.assert_told(health)
    assert not client.decisions
    client.park()
    driver = start_node('sim_node')
    client.until(lambda: client.decisions)
    assert client.decisions[0]['step'] == '0'
    assert float(client.decisions[0]['time_left']) > 9.5
    driver.end()
    client.until_health(state='active', said='Nobody listens to /cmd_vel.')


def test_a_recorder_that_is_asked_for_is_waited_for(start_node, client, record):
    running = start_node('guidance_node', {'recorder_timeout': 60.0})
    client.until(client.odometry.get_subscription_count)
    client.drive()
    client.until_health(state='active', said='Waiting for a recorder (recorder_timeout).')
    assert not client.decisions
    recording = record('own_topics:=true')
    client.until(lambda: len(client.decisions) > 5)
    running.end()
    outcome = recording.replayed()
    assert outcome.skipped == 0
    assert outcome.decisions >= 5


def test_where_no_recorder_comes_it_goes_on_without(fault, start_driving, client):
    running = start_driving({'recorder_timeout': 0.5})
    (said,) = [line for line in running.stderr.splitlines() if 'no recorder' in line]
    assert '[WARN]' in said
    fault.assert_said('—', 1, said.partition('[guidance]: ')[2])


def test_who_comes_late_is_told_the_latest_decision(start_active, client, make_odometry):
    start_active({'odom_timeout': 60.0})
    decision, _ = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    found, latched = [], QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(DECISION.type, '/guidance/decision', found.append, latched)
    client.until(lambda: found)
    values = {each.key: each.value for each in found[-1].status[0].values}
    assert values['stamp'] == decision['stamp']
