"""Obstacles that move: what of a message is used, and what is known at a time."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from cmpsp_ros.guidance import NANOSECONDS, MovingObstacles
from cmpsp_ros.guidance.messages import (
    Track,
    TrackError,
    Tracks,
    check_track_age,
    read_keys,
    told_tracks_of,
    tracks_of,
)
from cmpsp_ros.guidance.messages.tracks import track_keys
from cmpsp_ros.guidance.prediction.estimator import ObstacleTracker

KINDS = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}
FIELDS = {'x': 'f8', 'y': 'f8', 'vx': 'f8', 'vy': 'f8', 'radius': 'f8', 'id': 'i4'}
ROWS = [(1.0, 2.0, 0.5, -0.5, 0.25, 7), (3.0, 4.0, 0.0, 0.0, 0.0, 2)]


def cloud(rows=ROWS, fields=FIELDS, *, frame='odom', stamp=3.5, big=False, pad=0, **changes):
    """A `sensor_msgs/PointCloud2` of these points, fields in this order, with bytes between."""
    order, offsets, at = '>' if big else '<', [], 0
    for kind in fields.values():
        offsets.append(at)
        at += np.dtype(kind).itemsize + pad
    formats = [order + kind for kind in fields.values()]
    layout = np.dtype(
        {'names': list(fields), 'formats': formats, 'offsets': offsets, 'itemsize': at}
    )
    data = np.array([row[: len(fields)] for row in rows], dtype=layout).tobytes()
    seconds = math.floor(stamp)
    message = SimpleNamespace(
        header=SimpleNamespace(
            frame_id=frame,
            stamp=SimpleNamespace(sec=seconds, nanosec=round((stamp - seconds) * NANOSECONDS)),
        ),
        height=1,
        width=len(rows),
        fields=[
            SimpleNamespace(name=name, offset=offset, datatype=KINDS[kind], count=1)
            for (name, kind), offset in zip(fields.items(), offsets, strict=True)
        ],
        is_bigendian=big,
        point_step=at,
        row_step=at * len(rows),
        data=data,
        is_dense=True,
    )
    vars(message).update(changes)
    return message


FIRST = Track(7, 3_500_000_000, 0.25, 1.0, 2.0, 0.5, -0.5)
SECOND = Track(2, 3_500_000_000, 0.0, 3.0, 4.0, 0.0, 0.0)


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('pad', [0, 3])
@pytest.mark.parametrize(
    'fields',
    [
        FIELDS,
        dict.fromkeys(('x', 'y', 'vx', 'vy', 'radius'), 'f4') | {'id': 'u2'},
        FIELDS | {'intensity': 'f4'},
    ],
)
def test_messages_of_any_layout(fields, pad, big):
    rows = [(*row, 0.0) for row in ROWS]
    assert tracks_of(cloud(rows, fields, pad=pad, big=big), 'odom') == [FIRST, SECOND]


def test_a_message_of_none():
    assert tracks_of(cloud([]), 'odom') == []


def with_row(place, value):
    row = list(ROWS[0])
    row[place] = value
    return cloud([ROWS[1], tuple(row)])


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (cloud(frame='map'), "in frame 'map', wanted 'odom'"),
        (with_row(0, math.nan), r'Obstacle 7 \(point 1\) has a number that is not finite'),
        (with_row(3, math.inf), 'not finite'),
        (with_row(4, -0.1), 'a radius of -0.1 m, wanted 0 or more'),
        (with_row(1, 1e9), 'wanted one on Earth'),
        (with_row(2, 1e5), 'a velocity of'),
        (with_row(5, 2), 'Obstacle 2 is there twice'),
        (
            cloud(fields={k: v for k, v in FIELDS.items() if k != 'id'}),
            "field 'id': found none, wanted an integer",
        ),
        (
            cloud(fields=FIELDS | {'id': 'f4'}),
            "field 'id': found 1 of datatype 7, wanted an integer",
        ),
        (
            cloud(fields=FIELDS | {'vx': 'i4'}),
            "field 'vx': found 1 of datatype 5, wanted a float32 or float64",
        ),
        (cloud(width=3), 'Obstacles cannot be read: moving_obstacles: data: found'),
        (cloud(point_step=4), 'Obstacles cannot be read: moving_obstacles: data: found'),
        (cloud(data=b''), 'Obstacles cannot be read: moving_obstacles: data: found'),
        (cloud(width=2**31, height=2**31), 'wanted 1000 at most'),
    ],
)
def test_a_message_that_is_refused(message, reason):
    with pytest.raises(TrackError, match=reason):
        tracks_of(message, 'odom')


def test_messages_of_other_things_are_refused_in_words(fault):
    for message in (
        with_row(1, 1e9),
        with_row(2, 1e5),
        with_row(5, 2),
        cloud(fields=FIELDS | {'vx': 'i4'}),
        cloud(width=3),
        cloud(width=2**31, height=2**31),
    ):
        with pytest.raises(TrackError) as caught:
            tracks_of(message, 'odom')
        fault.assert_said('—', 1, str(caught.value))


def test_numbers_of_own_tracks_are_not_taken_by_others():
    rows = [(*ROWS[0][:-1], Track.SEEN + offset) for offset in (-1, 0)]
    fitting, own = (cloud([row]) for row in rows)
    assert told_tracks_of(fitting, 'odom')[0].id == Track.SEEN - 1
    assert tracks_of(own, 'odom')[0].id == Track.SEEN
    with pytest.raises(TrackError, match='Obstacle 16777216 has a number too large'):
        told_tracks_of(own, 'odom')


def test_age():
    early, late = cloud(stamp=1.0), cloud(stamp=2.5)
    check_track_age(early, 2 * NANOSECONDS, 1.0, 'Obstacles are')
    check_track_age(early, 0, 0.1, 'Obstacles are')
    with pytest.raises(TrackError, match=r'Obstacles are 1\.500 s old \(moving_obstacles.timeout'):
        check_track_age(early, 2_500_000_000, 1.0, 'Obstacles are')
    with pytest.raises(TrackError, match=r'1\.500 s ahead of the clock'):
        check_track_age(late, NANOSECONDS, 1.0, 'Obstacles are')


def seen(number, seconds, x=0.0):
    return Track(number, round(seconds * NANOSECONDS), 0.1, x, 0.0, 1.0, 0.0)


def at(tracks, seconds, timeout=1.0):
    return tracks.at(round(seconds * NANOSECONDS), timeout)


def test_what_is_known_goes_by_stamps_not_by_arrival():
    messages = [seen(1, 1.0), seen(1, 1.2), seen(2, 1.1), seen(1, 1.4)]
    for order in ((0, 1, 2, 3), (3, 2, 1, 0), (1, 3, 0, 2)):
        tracks = Tracks()
        for index in order:
            tracks.add([messages[index]])
        assert at(tracks, 0.9) == ()
        assert at(tracks, 1.0) == (seen(1, 1.0),)
        assert at(tracks, 1.3) == (seen(1, 1.2), seen(2, 1.1))
        assert at(tracks, 1.4) == (seen(1, 1.4), seen(2, 1.1))
        assert at(tracks, 2.2) == (seen(1, 1.4),)
        assert at(tracks, 2.5) == ()


def test_of_two_at_one_time_the_greater_counts():
    for pair in ((0.2, 0.3), (0.3, 0.2)):
        tracks = Tracks()
        tracks.add([Track(1, 5, radius, 0.0, 0.0, 0.0, 0.0) for radius in pair])
        assert tracks.at(5, 1.0)[0].radius == 0.3


def test_what_is_forgotten_before_a_time_changes_nothing_from_then_on():
    reports = [seen(1, 1.0), seen(1, 1.2), seen(2, 1.1), seen(1, 1.6), seen(3, 0.1)]
    for seconds in (1.3, 1.6, 2.0, 2.3, 3.0):
        tracks, all_of_them = Tracks(), Tracks()
        for each in (tracks, all_of_them):
            each.add(reports)
        tracks.forget_before(1_300_000_000, 1.0)
        assert sorted(map(len, tracks._known.values())) == [1, 2]
        assert at(tracks, seconds) == at(all_of_them, seconds)


def test_time_that_jumps_back():
    tracks = Tracks()
    tracks.add([seen(1, 1.0), seen(2, 9.0)])
    tracks.forget_after(2 * NANOSECONDS)
    assert at(tracks, 9.5, 100.0) == (seen(1, 1.0),)


def test_keys_read_back():
    assert read_keys(track_keys([FIRST, SECOND])) == [FIRST.key, SECOND.key]
    assert read_keys('') == []
    with pytest.raises(ValueError, match='wanted obstacles as id@stamp'):
        read_keys('7@3 x')


def looked(tracker, tracks, capacity=2, stamp=2 * NANOSECONDS):
    return tracker.update(stamp, np.zeros(3), tracks, MovingObstacles(capacity, 5.0, 0.1))


def test_brought_to_one_instant():
    discs = looked(ObstacleTracker(), [seen(3, 1.5, x=4.0)])
    np.testing.assert_allclose(discs.states, [[4.5, 0.0, 1.0, 0.0, 0.15, 0.1, 0.0]])
    assert discs.names == ('moving obstacle 3',)
    np.testing.assert_allclose(discs.after(1.0).states[0, [0, 4]], [5.5, 0.25])


def test_slots_are_kept_and_the_nearest_have_them():
    tracker = ObstacleTracker()
    near, far, nearer = seen(1, 2.0, x=3.0), seen(2, 2.0, x=5.0), seen(9, 2.0, x=2.0)
    assert looked(tracker, [near, far]).slots.tolist() == [0, 1]
    assert tracker.new_obstacle_seen
    assert looked(tracker, [near, far]).slots.tolist() == [0, 1]
    assert not tracker.new_obstacle_seen
    # The farther one gives way, and the one that stays keeps its slot.
    assert looked(tracker, [near, far, nearer]).slots.tolist() == [0, -1, 1]
    assert tracker.new_obstacle_seen
    assert looked(tracker, [far, nearer]).slots.tolist() == [0, 1]
    assert looked(tracker, []).slots.tolist() == []
