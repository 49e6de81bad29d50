"""Tracks of walkers among walls and posts, by a scanner with noise of 1 cm."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scanned_rooms import DOOR, ROOM, SENSOR, Faults, ScannedRoom, Score, occupied, straight

from cmpsp_ros.sensing import Sight

ACROSS, SLOW = straight(5.0, 1.0, 0.0, 0.8), straight(5.0, 1.0, 0.0, 0.3)
TOWARD, AWAY = straight(9.0, 3.2, -1.0, 0.0), straight(3.0, 3.2, 1.0, 0.0)
NEAR, FAR = straight(4.0, 1.0, 0.0, 0.8), straight(6.0, 5.0, 0.0, -0.8)
ABREAST = [straight(9.0, y, -0.7, 0.0) for y in (2.4, 2.95, 3.5)]
POSTS = [(4.0, 1.0, 0.2), (6.0, 5.0, 0.3), (3.0, 4.5, 0.05), (7.0, 1.2, 0.1)]


def turning(time):
    return 1.0, 3.0, 1.2 * math.sin(time)


def driving(time):
    return 1.0 + 0.4 * time, 3.0 + 0.5 * math.sin(time / 2.0), 0.3 * math.sin(time)


FAULTS = [
    pytest.param(Faults(), id='none'),
    pytest.param(Faults(missed=0.3), id='missed'),
    pytest.param(Faults(unknown=0.3), id='unknown'),
    pytest.param(Faults(odometry=(0.01, 0.005)), id='odometry'),
]
CASES = {
    'across': ({'walkers': [ACROSS]}, 5.0, 0.7),
    'slow': ({'walkers': [SLOW]}, 8.0, 1.5),
    'toward': ({'walkers': [TOWARD]}, 6.0, 0.5),
    'away': ({'walkers': [AWAY]}, 6.0, 0.5),
    'two that cross': ({'walkers': [NEAR, FAR]}, 5.0, 0.8),
    'three abreast': ({'walkers': ABREAST}, 8.0, 1.1),
    'behind a pillar': ({'walkers': [FAR], 'posts': [(4.0, 3.0, 0.3)]}, 5.0, 0.8),
    'turning robot': ({'walkers': [ACROSS], 'posts': POSTS[1:], 'robot': turning}, 5.0, 1.0),
    'through a door': ({'edges': DOOR, 'walkers': [straight(10.0, 3.1, -0.9, 0.0)]}, 8.0, 0.7),
    'along a wall': ({'walkers': [straight(9.0, 0.27, -0.8, 0.0)]}, 9.0, 0.9),
}


@pytest.mark.parametrize('faults', FAULTS)
@pytest.mark.parametrize('name', CASES)
def test_each_walker_is_one_track(name, faults):
    room, until, latest = CASES[name]
    score = Score(ScannedRoom(**room, faults=faults), until)
    assert [len(each) for each in score.ids] == [1] * len(room['walkers'])
    assert max(score.first) <= latest
    assert not score.false
    assert not score.missed
    # Of one along a wall, part of the wall may seem to belong to the body.
    assert max(score.errors) < (0.2 if name == 'along a wall' else 0.15)


@pytest.mark.parametrize('faults', FAULTS)
@pytest.mark.parametrize('robot', [turning, driving])
@pytest.mark.parametrize('edges', [ROOM, DOOR])
def test_nothing_moves_where_all_stands(edges, robot, faults):
    score = Score(ScannedRoom(edges, POSTS, robot=robot, faults=faults), 15.0)
    assert not score.false


class HighCamera(ScannedRoom):
    """A depth camera whose beams begin where they come down to the heights that count."""

    def sight(self, time):
        sight = super().sight(time)
        return replace(sight, begins=0.4 * sight.ends, is_sweep=False)


@pytest.mark.parametrize('name', ['across', 'two that cross'])
def test_a_camera_above_the_heights_that_count_tracks_each_walker(name):
    room, until, latest = CASES[name]
    score = Score(HighCamera(**room), until)
    assert [len(each) for each in score.ids] == [1] * len(room['walkers'])
    assert max(score.first) <= latest
    assert not score.false
    assert not score.missed


@pytest.mark.parametrize('faults', FAULTS)
def test_no_ghost_and_no_hole_is_left_behind(faults):
    empty, walked = (
        ScannedRoom(walkers=walkers, faults=faults)
        for walkers in ([], [ACROSS, TOWARD, straight(2.0, 5.72, 0.8, 0.0)])
    )
    walls = occupied(Score(empty, 6.0).sighting)
    found = occupied(Score(walked, 6.0).sighting)
    away = np.abs(found[:, None] - walls).max(axis=2)
    # Cells beside differ by noise, and some that returns are missed from.
    assert away.min(axis=1).max() < 0.16
    assert np.quantile(away.min(axis=0), 0.95 if faults.missed else 0.98) < 0.11


def test_who_walks_straight_away_after_standing_at_the_sensor_moves():
    """Nothing is seen of the places that somebody enters behind himself."""

    def walker(time):
        return 1.0 + max(3.5 - 0.9 * time, 0.6) + 0.7 * max(time - 4.0, 0.0), 3.0

    score = Score(ScannedRoom(walkers=[walker]), 9.0)
    assert score.ids == [{0}]
    assert score.missed == 0


@pytest.mark.parametrize('speed', [0.5, 0.86])
def test_who_comes_out_from_behind_the_scanner_is_known_at_once(speed):
    """The places were free when they were last in sight, seconds ago."""

    def robot(time):
        return 4.0, 3.0, math.pi if time < 2.0 else 0.9 * max(time - 4.0, 0.0)

    def walker(time):
        away = 1.1 - speed * (time - 4.5)
        # As through a door behind it.
        behind = 4.0 - 0.97 * away, 3.0 + 0.26 * away
        return behind if time > 3.0 else (100.0, 100.0)

    known = [
        time
        for time, sighting in ScannedRoom(walkers=[walker], robot=robot).run(6.0)
        for each in sighting.tracks
        if time > 2.0 and math.dist((each.x, each.y), walker(time)) < 0.4
    ]
    # Its first hits on him are of 4.3 s.
    assert min(known) <= 4.75


def test_who_stands_at_the_edge_of_view_is_not_lost():
    """One side of him is out of view, and what is seen has stood there for a second."""

    def walker(time):
        away = max(3.0 - time, 0.65)
        return 4.0 - 0.5 * away, 3.0 - 0.87 * away

    room = ScannedRoom(walkers=[walker], robot=lambda _time: (4.0, 3.0, 0.0))
    tracks = [each for time, sighting in room.run(6.0) for each in sighting.tracks if time > 1.0]
    assert len(tracks) > 10
    assert {each.name for each in tracks} == {'person 1'}
    assert max(each.position_stddev for each in tracks) < 0.15
    assert np.hypot(*(occupied(room.known.at(0, np.zeros(3))) - walker(6.0)).T).min() < 0.3


def turning_its_back(time):
    return 1.0, 3.0, 0.0 if time < 2.0 else math.pi


@pytest.mark.parametrize(
    ('walker', 'until'),
    [(straight(10.0, 3.2, -1.0, 0.0), 7.9), (AWAY, 9.0)],
    ids=['toward', 'away'],
)
@pytest.mark.parametrize('edges', [ROOM, []], ids=['room', 'open hall'])
def test_who_is_where_the_scanner_does_not_look_is_expected_for_longer(edges, walker, until):
    room = ScannedRoom(edges, walkers=[walker], robot=turning_its_back)
    lasting = [
        (time, each)
        for time, sighting in room.run(until)
        for each in sighting.tracks
        if time >= 2.0
    ]
    last, track = lasting[-1]
    assert last == pytest.approx(1.9 + 6.0, abs=0.11)
    assert math.dist((track.x, track.y), walker(last)) < 3.0 * track.position_stddev
    assert {each.name for _, each in lasting} == {'person 1'}
    assert track.position_stddev > 1.0


def test_doubt_grows_and_ends_a_track_where_clouds_have_no_points():
    room = HighCamera(walkers=[AWAY])
    assert len(Score(room, 2.0).sighting.tracks) == 1
    pose, none, nothing, tracks = np.array(room.robot(0)), np.empty(0, int), np.empty((0, 2)), []
    for stamp in range(2_100_000_000, 9_000_000_000, 100_000_000):
        room.known.add(Sight(SENSOR, stamp, none, nothing, nothing, none > 0, is_sweep=False))
        room.known.update(stamp, pose)
        tracks += room.known.at(stamp, pose).tracks
    assert tracks[-1].stamp == 8_000_000_000
    assert tracks[-1].position_stddev > 1.0


@pytest.mark.parametrize('y', [4.5, 5.2, 5.6])
@pytest.mark.parametrize('speed', [0.6, 1.0])
@pytest.mark.parametrize('back', [4.0, 6.0])
def test_a_wall_that_comes_into_view_is_not_who_was_lost(y, speed, back):
    def robot(time):
        return 1.0, 3.0, math.pi if 2.0 <= time <= back else 0.0

    def walker(time):
        return (3.0 + speed * time, y) if time < 2.2 else (100.0, 100.0)

    room = ScannedRoom(walkers=[walker], robot=robot)
    tracks = [each for time, seen in room.run(back + 2.0) for each in seen.tracks if time > back]
    # For two scans he may still be where he is expected.
    assert len(tracks) <= 2


@pytest.mark.parametrize('speed', [0.9, 1.2])
@pytest.mark.parametrize('apart', [0.0, 0.3])
def test_two_who_meet_are_two(speed, apart):
    walkers = [straight(3.0, 3.0, speed, 0.0), straight(9.0, 3.0 + apart, -speed, 0.0)]
    room = ScannedRoom(walkers=walkers, robot=lambda _time: (6.0, 0.6, math.pi / 2.0))
    score = Score(room, 6.0 / speed)
    assert score.missed == 0
    assert not score.false


@pytest.mark.parametrize(('speed', 'end'), [(0.4, 3.4), (0.5, 3.45), (0.6, 3.5)])
def test_who_stops_half_behind_a_pillar_is_not_lost(speed, end):
    def walker(time):
        return 5.0, min(1.0 + 0.8 * min(time, 2.0) + speed * max(time - 2.0, 0.0), end)

    room = ScannedRoom(
        walkers=[walker], posts=[(4.0, 3.0, 0.3)], robot=lambda _time: (1.0, 3.0, 0.0)
    )
    for time, seen in room.run(6.0):
        if time > 3.8:
            # A second after he has stopped he counts as static.
            assert len(seen.tracks) == 1 or time > 4.2
            assert all(each.position_stddev < 0.1 for each in seen.tracks)
            assert all(math.dist((each.x, each.y), walker(time)) < 0.1 for each in seen.tracks)


def test_who_comes_to_where_another_was_lost_is_kept():
    """The track in doubt goes where two are at one place."""

    def robot(time):
        return 4.0, 3.0, math.pi if time < 2.0 else math.radians(40.0)

    def stops(time):
        return (2.5, 3.0 - 0.8 * max(1.2 - time, 0.0)) if time < 2.0 else (100.0, 100.0)

    def comes(time):
        return (2.5, max(3.0 + 0.8 * (3.7 - time), 3.1)) if time > 1.8 else (100.0, 100.0)

    for time, seen in ScannedRoom(walkers=[stops, comes], robot=robot).run(3.7):
        known = [each for each in seen.tracks if each.position_stddev < 0.17]
        near = [math.dist((each.x, each.y), comes(time)) for each in known]
        if time > 3.0:
            assert min(near, default=math.inf) < 0.3


def test_a_jump_of_odometry_moves_nothing():
    room = ScannedRoom(posts=POSTS, jumps=(2.0, (0.4, 0.2, 0.1)))
    assert not Score(room, 6.0).false


def test_tracks_are_predicted_for_the_time_of_odometry_and_forgotten_with_it():
    room = ScannedRoom(walkers=[TOWARD])
    sighting = Score(room, 2.0).sighting
    (track,) = sighting.tracks
    assert track.stamp == sighting.stamp
    assert track.name == 'person 1'
    assert (track.vx, track.vy) == pytest.approx((-1.0, 0.0), abs=0.1)
    assert 0.0 < track.position_stddev < 0.1
    assert 0.0 < track.velocity_stddev < 0.3
    assert room.known.at(0, np.zeros(3)) is sighting
    room.known.forget()
    assert room.known.at(0, np.zeros(3)) is None


@pytest.mark.parametrize(('begin', 'speed'), [(5.4, 0.25), (5.4, 0.3), (5.2, 0.35)])
def test_what_has_long_stood_is_nobody_out_of_sight(begin, speed):
    """He goes behind the scanner on his legs, and could be anywhere since."""
    room = ScannedRoom(
        walkers=[straight(begin, 4.4, -speed, 0.0, end=(begin - 4.2) / speed)],
        posts=(posts := [(6.3, 5.0, 0.2), (7.5, 4.0, 0.3), (6.5, 1.5, 0.3)]),
        robot=lambda _: (6.0, 3.0, 0.0),
        faults=Faults(legs=True, missed=0.3),
    )
    tracks = [each for _, seen in room.run(14.0) for each in seen.tracks]
    assert max(each.position_stddev for each in tracks) > 1.0
    assert min(math.dist((each.x, each.y), post[:2]) for each in tracks for post in posts) > 0.9


@pytest.mark.parametrize('speed', [0.8, 1.0, 1.2])
def test_who_parts_from_somebody_is_known_at_once(speed):
    """Two who walk close together may look like one."""

    def stays(time):
        return 4.5 + 0.6 * time, 2.9

    def turns(time):
        return 4.5 + 0.6 * min(time, 2.0) - speed * max(time - 2.0, 0.0), 3.1

    score = Score(ScannedRoom(walkers=[stays, turns]), 2.45)
    x, y = turns(2.4)
    near = [each for each in score.sighting.tracks if math.hypot(each.x - x, each.y - y) < 0.3]
    assert min(each.vx for each in near) < -0.3 * speed
    assert not score.false


@pytest.mark.parametrize('speed', [1.0, 1.3])
@pytest.mark.parametrize('behind', [0.1, 0.2])
def test_who_comes_out_of_a_pair_is_not_where_the_other_is(behind, speed):
    """While two look like one, both are in its disc."""

    def stays(time):
        return 5.0 - 0.4 * time, 3.3

    def comes(time):
        return 5.0 + behind - 0.4 * min(time, 3.0) - speed * max(time - 3.0, 0.0), 3.0

    for time, seen in ScannedRoom(walkers=[stays, comes]).run(4.5):
        away = [math.dist((each.x, each.y), comes(time)) - each.radius for each in seen.tracks]
        assert time < 1.0 or min(away) < -0.1


@pytest.mark.parametrize('later', [2.2, 2.66])
@pytest.mark.parametrize('aside', [-0.15, 0.0, 0.15])
@pytest.mark.parametrize('turns_at', [2.5, 2.69, 2.9])
def test_who_turns_back_where_another_did_is_not_lost(turns_at, aside, later):
    """His front hides where nobody was since: all that is known is that somebody was there."""
    turns = 4.2 + later

    def first(time):
        since = min(max(time - 4.2, -3.0), 3.0)
        return 2.7 - 0.36 * since**2, 3.0 + aside - 0.21 * since**2

    def second(time):
        since = max(time - turns, -2.5)
        return turns_at - 0.36 * since**2, 3.0 - 0.035 * since**2

    room = ScannedRoom(walkers=[first, second], robot=lambda _: (1.04, 3.65, 0.0))
    for time, seen in room.run(turns + 0.4):
        if time > turns - 1.5:
            away = [math.dist((each.x, each.y), second(time)) for each in seen.tracks]
            assert min(away) < 0.25
