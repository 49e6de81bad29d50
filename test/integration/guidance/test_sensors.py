"""Sensors over DDS: no command without them, and none on what they cannot have seen."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live import PERIOD_NS
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import LaserScan, PointCloud2, PointField

POSE = (0.0, -9.25, 0.0)
# Tests take their time between messages.
SEEING = {'odom_timeout': 60.0, 'sensors.names': '[front]', 'sight.timeout': 0.5}


@pytest.fixture
def show(client):
    """Publish a scan of an empty place as sensors do: `show(stamp, frame_id='base_scan')`."""
    tell = client.teller(LaserScan, 'scan', qos_profile_sensor_data)

    def send(stamp, frame_id='base_scan', **changes):
        message = LaserScan(
            angle_min=-3.0, angle_max=3.0, angle_increment=0.01, range_min=0.1, range_max=9.0,
            ranges=[math.inf] * 601,
        )  # fmt: skip
        for key, value in changes.items():
            setattr(message, key, value)
        message.header.stamp = Time(nanoseconds=stamp).to_msg()
        message.header.frame_id = frame_id
        tell(message)

    return send


def test_scans_that_come_are_used_and_those_that_do_not_stop_the_robot(
    fault, start_node, client, make_odometry, show
):
    running, seen = start_node('guidance_node', SEEING), []
    client.node.create_subscription(OccupancyGrid, '/guidance/sighting', seen.append, 10)
    client.connect()
    client.until_health(state='active')
    stamp = client.now()

    def decide(reason, *, scanned):
        """Odometry until a decision for such a reason, each with a scan or without one."""
        nonlocal stamp
        for _ in range(20):
            stamp += PERIOD_NS
            if scanned:
                show(stamp)
            decision, command = client.decide(make_odometry(stamp, POSE))
            if reason in decision['reason']:
                fault.assert_decided(decision)
                return decision, command
        raise AssertionError(decision['reason'])

    waiting = 'Waiting for the first usable message of sensor front on scan.'
    assert decide(waiting, scanned=False)[1] == (0.0, 0.0)
    decision, command = decide('The plan meets every constraint.', scanned=True)
    assert command[0] > 0.5
    client.until(lambda: any(_stamp(each) == int(decision['sighting']) for each in seen))
    # Behind the scanner nothing is known.
    assert [seen[-1].data[k] for k in (20_000, 20_100, 20_199)] == [-1, 0, 0]
    assert decide('Sensor front has shown nothing for', scanned=False)[1] == (0.0, 0.0)
    assert decide('The plan meets every constraint.', scanned=True)[1][0] > 0.5
    for changes, reason in (
        ({'frame_id': 'odom'}, "front: frame_id: found 'odom', wanted 'base_scan'"),
        ({'angle_increment': 0.1}, 'front: ranges: found 601, wanted 61'),
        ({'ranges': [math.nan] * 601}, 'front: ranges: found 601, none of them valid'),
        ({'ranges': [0.0] * 601}, 'front: ranges: found 601, none of them valid, the first 0'),
    ):
        show(stamp, **changes)
        client.decide(make_odometry(stamp := stamp + PERIOD_NS, POSE))
        health = client.until_health(level=DiagnosticStatus.WARN, said=reason)
        fault.assert_told(health)
        show(stamp := stamp + PERIOD_NS)
    assert 'Traceback' not in running.stderr


# A camera 0.3 m above the floor.
SEEING_FLOOR = {
    'odom_timeout': 60.0,
    'sensors.names': '[front]',
    'sensors.front.type': 'cloud',
    'sensors.front.reach': 5.0,
    'sensors.front.heights': '[-0.25, 0.1]',
    'sight.timeout': 60.0,
}


def test_points_on_the_floor_show_where_to_drive_and_no_points_nothing(
    start_active, client, make_odometry
):
    running = start_active(SEEING_FLOOR)
    tell = client.teller(PointCloud2, 'scan', qos_profile_sensor_data)
    stamp = client.now()

    def decide(points):
        nonlocal stamp
        stamp += PERIOD_NS
        tell(cloud_of(points, stamp))
        return client.decide(make_odometry(stamp, POSE))

    # A cloud may come after the odometry of its time: it counts for the next.
    for _ in range(10):
        decision, command = decide(np.empty((0, 3)))
        assert command[0] < 0.1
    assert 'has not been seen yet' in decision['reason']
    angles, away = np.meshgrid(np.linspace(-1.0, 1.0, 400), np.linspace(0.3, 7.0, 150))
    floor = np.stack([away * np.cos(angles), away * np.sin(angles), np.full(away.shape, -0.3)], 2)
    driven = [decide(floor.reshape(-1, 3))[1][0] for _ in range(10)]
    assert max(driven) > 0.5
    assert 'Traceback' not in running.stderr


def cloud_of(points, stamp):
    fields = [
        PointField(name=each, offset=4 * k, datatype=7, count=1) for k, each in enumerate('xyz')
    ]
    message = PointCloud2(height=1, width=len(points), fields=fields, point_step=12)
    message.row_step, message.data = 12 * len(points), points.astype('<f4').tobytes()
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    message.header.frame_id = 'base_scan'
    return message


def _stamp(message):
    return Time.from_msg(message.header.stamp).nanoseconds
