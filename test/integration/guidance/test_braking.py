"""Stops of a robot whose position is known: it brakes along the path that was audited."""

import math
from array import array

import numpy as np
import pytest
from live import LATCHED, MS, PERIOD_NS, ZERO
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import LaserScan

ACCELERATION = 30.0
"""Limit of the wheels in these tests [rad/s^2]: a stop takes more than half a second."""

COURSES = {
    'sensor': {'sensors.names': '[front]', 'sight.timeout': 0.5},
    'map': {
        'map.topic': 'floor', 'road.type': 'none', 'goal.position': '[6.0, -9.25]',
        'initial_guess.type': 'road', 'map.timeout': 0.5,
    },
}  # fmt: skip


def scan():
    message = LaserScan(
        angle_min=-3.0, angle_max=3.0, angle_increment=0.01, range_min=0.1, range_max=9.0,
        ranges=[math.inf] * 601,
    )  # fmt: skip
    message.header.frame_id = 'base_scan'
    return message


def floor():
    """A floor of 12 x 6 m around the start."""
    message = OccupancyGrid(data=array('b', np.zeros((60, 120), np.int8).tobytes()))
    message.header.frame_id = 'odom'
    message.info.resolution, message.info.height, message.info.width = 0.1, 60, 120
    message.info.origin.position.x, message.info.origin.position.y = -2.0, -12.25
    message.info.origin.orientation.w = 1.0
    return message


SOURCES = {
    'sensor': (LaserScan, 'scan', qos_profile_sensor_data, scan, 'Sensor front has shown nothing'),
    'map': (OccupancyGrid, 'floor', LATCHED, floor, 'The map is '),
}


@pytest.mark.parametrize('source', SOURCES)
def test_a_robot_that_sees_or_knows_nothing_more_brakes_within_its_limit(
    start_node, record, client, source
):
    kind, topic, qos, make, reason = SOURCES[source]
    publisher = client.node.create_publisher(kind, topic, qos)

    def tell():
        message = make()
        message.header.stamp = Time(nanoseconds=client.now()).to_msg()
        publisher.publish(message)

    recording = record()
    given = {'robot.max_wheel_acceleration': ACCELERATION, 'recorder_timeout': 60.0}
    guidance = start_node('guidance_node', {**given, 'final_time': 12.0, **COURSES[source]})
    client.connect()
    telling = client.node.create_timer(0.1, tell)
    client.drive()
    client.until_driving()
    client.node.destroy_timer(telling)
    stops = until_rest(client, reason)
    assert_braked_in_time(client.decisions, stops)
    telling = client.node.create_timer(0.1, tell)
    client.until_driving()
    client.node.destroy_timer(telling)
    client.park()
    guidance.end()
    assert 'Traceback' not in guidance.stderr
    outcome = recording.replayed()
    assert outcome.stops >= len(stops)


def until_rest(client, reason):
    """The decisions with which the robot comes to rest for a reason."""
    count = len(client.decisions)

    def stopped():
        found = [each for each in client.decisions[count:] if each['reason'].startswith(reason)]
        return found if found and wheels(found[-1]).max() == 0.0 else []

    return client.until(stopped)


def wheels(decision):
    return np.abs([float(decision[f'wheel_speed_{side}']) for side in ('right', 'left')])


def assert_braked_in_time(decisions, stops):
    """No wheel slows down faster than its limit, and no command lasts much longer than a period."""
    before = decisions[decisions.index(stops[0]) - 1]
    speeds = np.array([wheels(each) for each in (before, *stops)])
    assert len(stops) > 2
    assert np.abs(np.diff(speeds, axis=0)).max() <= ACCELERATION * PERIOD_NS / 1e9 + 1e-6
    assert {each['braking'] for each in stops} == {'true'}
    lasting = np.diff([int(each['stamp']) for each in (before, *stops)])
    assert (lasting >= PERIOD_NS - 1 * MS).all()
    assert (lasting < 1.5 * PERIOD_NS).all()


def test_a_cancelled_goal_is_braked_for(interfaces, start_node, record, client):
    interfaces('nav2_msgs')
    from nav2_msgs.action import NavigateToPose
    from rclpy.action import ActionClient

    recording = record()
    given = {'robot.max_wheel_acceleration': ACCELERATION, 'recorder_timeout': 60.0}
    guidance = start_node('guidance_node', {**given, 'goal.wait': True})
    client.connect()
    client.drive()
    actions = ActionClient(client.node, NavigateToPose, 'navigate_to_pose')
    client.until(actions.server_is_ready)
    request = NavigateToPose.Goal()
    request.pose.header.frame_id = 'odom'
    request.pose.pose.position.x, request.pose.pose.position.y = 9.3, 4.0
    sent = actions.send_goal_async(request)
    client.until(sent.done)
    client.until_driving()
    # Just after a command.
    count = len(client.commands)
    client.until(lambda: len(client.commands) > count)
    cancelled = sent.result().cancel_goal_async()
    client.until(cancelled.done)
    stops = until_rest(client, 'The goal was cancelled.')
    assert_braked_in_time(client.decisions, stops)
    assert {each['cancelled'] for each in stops} == {'true'}
    client.park()
    assert client.commands[-1] == ZERO
    guidance.end()
    assert 'Traceback' not in guidance.stderr
    recording.replayed()
    actions.destroy()
