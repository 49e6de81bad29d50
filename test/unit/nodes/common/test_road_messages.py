"""Roads in messages, and settings while one is still to come."""

import math

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from cmpsp_ros.nodes.common.messages import road_in
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    guidance_settings,
    lacks_road,
)

OPEN = [(0.0, 0.0), (3.0, 0.0), (6.0, 1.0)]
TOLD = {'road.type': 'corridor', 'road.source': 'topic'}


def message(points, frame_id='odom', own=''):
    path = Path()
    path.header.frame_id = frame_id
    for place in points:
        pose = PoseStamped()
        pose.header.frame_id = own
        pose.pose.position.x, pose.pose.position.y = place
        path.poses.append(pose)
    return path


def test_a_road_is_its_points_and_closed_where_it_ends_as_it_begins():
    flat = [0.0, 0.0, 3.0, 0.0, 6.0, 1.0]
    assert road_in(message(OPEN), 'odom') == {'road.points': flat, 'road.closed': False}
    closed = road_in(message([*OPEN, OPEN[0]], own='odom'), 'odom')
    assert closed == {'road.points': flat, 'road.closed': True}


@pytest.mark.parametrize(
    ('told', 'said'),
    [
        (message(OPEN, 'map'), "road: found frame 'map', wanted 'odom' (frame_id)"),
        (message(OPEN, own='map'), 'road, point 0 (from 0): found frame'),
        (message([]), 'road: found 0 points, wanted some, and 10000 at most'),
        (message([(0.0, 0.0)] * 10_001), 'road: found 10001 points'),
        (message([*OPEN, (math.inf, 0.0)]), 'road, point 3 (from 0): found [inf, 0.0], wanted'),
    ],
)
def test_what_is_no_road_is_refused_by_the_point(told, said):
    with pytest.raises(ParameterError) as caught:
        road_in(told, 'odom')
    assert str(caught.value).startswith(said)


@pytest.mark.parametrize('follow', [0.0, 1.0])
def test_the_rest_is_checked_before_a_road_has_come(follow):
    values = TABLE.resolve(TOLD | {'follow.speed': follow})
    assert lacks_road(values)
    check_simulation(values)
    settings = guidance_settings(values)
    assert settings.road.width > 2.0 * settings.robot_radius
    with pytest.raises(ParameterError, match='odom_timeout'):
        guidance_settings(TABLE.resolve(TOLD | {'odom_timeout': -1.0}))
    come = TABLE.reconfigure(values, road_in(message([*OPEN, OPEN[0]]), 'odom'))
    assert not lacks_road(come)


@pytest.mark.parametrize('kind', ['annulus', 'none'])
def test_only_a_corridor_comes_from_a_topic(kind):
    with pytest.raises(ParameterError, match=f'road.source: found topic, .* road.type {kind}'):
        guidance_settings(TABLE.resolve(TOLD | {'road.type': kind}))
