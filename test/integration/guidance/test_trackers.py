"""Other trackers over DDS: their objects are known to decisions, each once, and in the bag."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live import PERIOD_NS, transform
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2

from cmpsp_ros.guidance.messages import Track, tracks_of
from cmpsp_ros.nodes.common.messages import cloud_of
from cmpsp_ros.robots.motion import arc_ends

pytestmark = pytest.mark.timeout(300)

POSE = (0.0, -9.25, 0.0)
ROOM = {
    'odom_timeout': 60.0,
    'moving_obstacles.capacity': 2,
    'moving_obstacles.timeout': 50.0,
    'trackers.names': '[radar, lidar]',
    'trackers.radar.topic': 'radar_tracks',
    'trackers.radar.type': 'radar_msgs/msg/RadarTracks',
    'trackers.lidar.topic': 'lidar_tracks',
}
RADAR, LIDAR = 2 * Track.SEEN, 3 * Track.SEEN


@pytest.fixture
def tell(interfaces, client):
    """Tell of a radar's track and of a cloud: `tell(stamp, radar=None, cloud=None)`."""
    interfaces('radar_msgs')
    from radar_msgs.msg import RadarTrack, RadarTracks

    radars = client.node.create_publisher(RadarTracks, 'radar_tracks', 10)
    clouds = client.node.create_publisher(PointCloud2, 'lidar_tracks', 10)

    def send(stamp, radar=None, cloud=None, frame_id='odom'):
        client.until(radars.get_subscription_count)
        client.until(clouds.get_subscription_count)
        if radar is not None:
            track, message = RadarTrack(), RadarTracks()
            track.position.x, track.position.y, track.velocity.x, track.velocity.y = radar
            message.header.frame_id, message.tracks = frame_id, [track]
            message.header.stamp = Time(nanoseconds=stamp).to_msg()
            radars.publish(message)
        if cloud is not None:
            clouds.publish(cloud_of([Track(5, stamp, 0.4, *cloud, 0.02, 0.02)], stamp, frame_id))

    return send


def test_one_that_two_trackers_see_is_once_in_the_decision_and_in_the_bag(
    start_active, client, record, make_odometry, tell
):
    heard = []
    client.node.create_subscription(PointCloud2, '/guidance/tracks', heard.append, 10)
    recording = record()
    start_active(ROOM)
    recording.until_all_is_heard()
    pose, stamp, numbers = np.array(POSE), client.now(), []
    for step in range(20):
        time, seen = step * 0.2, None
        if step >= 5:
            seen = (6.0 - 0.3 * time, -8.0, -0.3, 0.0)
        cloud = (seen[0] + 0.05, seen[1], -0.28, 0.02) if seen and step >= 10 else None
        tell(stamp, seen, cloud)
        decision, command = client.decide(make_odometry(stamp, pose))
        numbers.append(decision.get('moving_obstacles', '').partition('@')[0])
        pose = arc_ends(pose[None], np.array([command]), np.array([0.2]))[0]
        stamp += PERIOD_NS
    # A message may come after the odometry of its time: then it is known at the next.
    assert set(numbers[:5]) == {''}
    assert str(RADAR) in numbers[5:11]
    assert set(numbers[12:]) == {str(LIDAR)}, 'the surer one, once'
    client.until(lambda: len(heard) > 10)
    tracks = [each for message in heard for each in tracks_of(message, 'odom')]
    assert {each.id for each in tracks} == {RADAR, LIDAR}
    assert len({each.key for each in tracks}) == len(tracks), 'none is published twice'
    assert recording.replayed().decisions == 20


def test_what_cannot_be_used_is_said(start_active, client, make_odometry, tell):
    start_active(ROOM)
    stamp = client.now()
    client.decide(make_odometry(stamp, POSE))
    tell(stamp, (math.nan, 0.0, 0.0, 0.0))
    said = 'A message of tracker radar is refused: Object'
    client.until_health(level=DiagnosticStatus.WARN, said=said)
    tell(stamp, (6.0, -8.0, 0.0, 0.0), frame_id='radar')
    client.until_health(level=DiagnosticStatus.WARN, said="frame 'radar', wanted 'odom'")
    tell(client.now(), (6.0, -8.0, 0.0, 0.0), (6.0, -8.0, 0.0, 0.0))
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')


def test_a_tracker_that_is_silent_is_told(fault, start_active, client, make_odometry, tell):
    start_active({**ROOM, 'moving_obstacles.timeout': 2.0})
    client.decide(make_odometry(client.now(), POSE))
    silent = 'for more than 2 s (moving_obstacles.timeout) from tracker radar, tracker lidar.'
    fault.assert_told(client.until_health(level=DiagnosticStatus.WARN, said=silent))
    radar = (6.0, -8.0, 0.0, 0.0)
    tell(client.now(), radar, radar)
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
    client.until_health(level=DiagnosticStatus.WARN, said=silent)


def test_a_radar_on_the_robot_tells_of_velocities_relative_to_it(
    interfaces, start_active, client, make_odometry, tell
):
    interfaces('tf2_msgs')
    from tf2_msgs.msg import TFMessage

    moving = client.node.create_publisher(TFMessage, '/tf', 100)
    start_active(ROOM)
    client.until(moving.get_subscription_count)
    heard, stamp = [], client.now()
    client.node.create_subscription(PointCloud2, '/guidance/tracks', heard.append, 10)
    # It drives at 0.5 m/s; what comes nearer at 0.5 m/s stands.
    for step in range(-4, 1):
        at = stamp + step * 50_000_000
        x = 1.0 + 0.5 * step * 0.05
        moving.publish(TFMessage(transforms=[transform('odom', 'radar', (x, -9.0, 0.0), at)]))
    tell(stamp, (5.0, 1.0, -0.5, 0.0), frame_id='radar')

    def told():
        nonlocal stamp
        client.decide(make_odometry(stamp := stamp + PERIOD_NS, POSE))
        return heard

    client.until(told)
    (track,) = tracks_of(heard[0], 'odom')
    assert (track.x, track.y) == pytest.approx((6.0, -8.0))
    assert (track.vx, track.vy) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_a_type_whose_package_is_missing_is_an_error(start_node, client):
    kind = 'vision_msgs/msg/Detection3DArray'
    start_node('guidance_node', {'trackers.names': '[lidar]', 'trackers.lidar.type': kind})
    wanted = 'wanted the package vision_msgs to be installed, as by apt install'
    health = client.until_health(level=DiagnosticStatus.ERROR, said=wanted)
    assert f'trackers.lidar.type: found {kind!r}' in health['said']
