"""Obstacles that the simulator moves, and the message that tells of them."""

import math
from dataclasses import replace

import pytest

from cmpsp_ros.guidance.messages import Track, TrackError, tracks_of
from cmpsp_ros.nodes.common.messages import cloud_of
from cmpsp_ros.nodes.sim.surroundings import Traffic
from cmpsp_ros.parameters import TABLE

SECOND = 1_000_000_000
VALUES = TABLE.resolve(
    {
        'moving_obstacles.names': ['cart', 'dog'],
        'moving_obstacles.cart.center': [1.0, 2.0],
        'moving_obstacles.cart.velocity': [0.5, -0.25],
        'moving_obstacles.cart.radius': 0.3,
        'moving_obstacles.dog.center': [-4.0, 0.0],
        'moving_obstacles.dog.velocity': [0.0, 1.0],
        'moving_obstacles.dog.radius': 0.2,
    }
)


def test_they_stand_until_they_are_told_to_move_and_after_a_reset():
    traffic = Traffic(VALUES)
    assert len(traffic) == 2
    cart, dog = traffic.at(3 * SECOND)
    assert cart == Track(0, 3 * SECOND, 0.3, 1.0, 2.0, 0.0, 0.0)
    assert (dog.id, dog.x, dog.y) == (1, -4.0, 0.0)
    traffic.begin(3 * SECOND)
    traffic.begin(4 * SECOND)
    cart, dog = traffic.at(5 * SECOND)
    assert cart == Track(0, 5 * SECOND, 0.3, 2.0, 1.5, 0.5, -0.25)
    assert (dog.y, dog.vy) == (2.0, 1.0)
    traffic.reset()
    assert traffic.at(6 * SECOND)[0] == Track(0, 6 * SECOND, 0.3, 1.0, 2.0, 0.0, 0.0)


@pytest.mark.parametrize('count', [0, 1, 2])
def test_what_is_written_reads_back_bit_for_bit(count):
    tracks = Traffic(VALUES).at(SECOND // 3)[:count]
    message = cloud_of(tracks, SECOND // 3, 'map')
    assert tracks_of(message, 'map') == tracks


def test_doubts_read_back_and_are_zero_where_a_message_lacks_them():
    sure, doubtful = (
        Track(1, SECOND, 0.3, 1.0, 2.0, 0.5, 0.0),
        Track(2, SECOND, 0.3, 0.0, 0.0, 0.0, 0.0),
    )
    doubtful = replace(doubtful, position_stddev=0.1, velocity_stddev=0.25)
    message = cloud_of([sure, doubtful], SECOND, 'map')
    assert tracks_of(message, 'map') == [sure, doubtful]
    assert [each.name for each in cloud_of([sure], SECOND, 'map').fields][-2:] == ['z', 'id']


@pytest.mark.parametrize('stddev', [-0.1, math.inf, math.nan])
def test_a_doubt_that_is_none_is_refused(stddev):
    track = Track(7, SECOND, 0.3, 1.0, 2.0, 0.5, 0.0, velocity_stddev=stddev)
    with pytest.raises(TrackError, match='Obstacle 7'):
        tracks_of(cloud_of([track], SECOND, 'map'), 'map')


def test_no_obstacles_without_names():
    assert len(Traffic(TABLE.resolve({}))) == 0
