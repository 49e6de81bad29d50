"""Tracks of people who stop, stand, and set off again."""

import math

import numpy as np
import pytest
from scanned_rooms import Faults, ScannedRoom, Score, occupied, straight


def test_what_stops_is_static_until_it_goes_on():
    def walker(time):
        return 5.0, 1.0 + 0.8 * (min(time, 2.0) + max(time - 6.0, 0.0))

    room = ScannedRoom(walkers=[walker])
    stands = Score(room, 5.5).sighting
    assert not stands.tracks
    assert np.hypot(*(occupied(stands) - walker(5.5)).T).min() < 0.3
    score = Score(room, 8.0, 5.6)
    assert score.ids == [{0}]
    assert score.first[0] <= 6.6
    assert np.hypot(*(occupied(score.sighting) - walker(5.5)).T).min() > 0.5


def test_who_stands_against_the_robot_does_not_become_static():
    """A person who pushes the robot moves too slowly to be seen moving."""

    def walker(time):
        return 1.55 + max(2.5 - 0.8 * time, 0.0), 3.0

    room = ScannedRoom(walkers=[walker])
    tracks = [seen.tracks for time, seen in room.run(9.0) if time > 1.0]
    assert [len(each) for each in tracks] == [1] * len(tracks)
    x, y = occupied(room.known.at(0, np.zeros(3))).T
    assert not (np.hypot(x - 1.55, y - 3.0) < 0.3).any()


@pytest.mark.parametrize('legs', [False, True])
@pytest.mark.parametrize('length', [0.12, 0.16, 0.25])
def test_who_steps_back_from_the_robot_and_comes_again_is_not_lost(length, legs):
    """A place that he leaves for less than the scanner errs still counts as occupied for long."""

    def walker(time):
        back = length * (1.0 - ((time - 4.6) / 0.6) ** 2)
        return 1.5 + max(1.6 - 0.8 * time, back, 0.0), 3.0

    room = ScannedRoom(walkers=[walker], faults=Faults(legs=legs))
    for time, (track,) in ((time, seen.tracks) for time, seen in room.run(8.0) if time > 1.0):
        assert math.dist((track.x, track.y), walker(time)) < (0.25 if legs else 0.15)


def test_who_follows_the_robot_as_it_creeps_away_is_not_lost():
    """All that he takes up was taken up a second ago, and no scan shows that he moves."""

    def robot(time):
        return 2.0 - 0.05 * max(time - 4.0, 0.0), 3.0, 0.0

    def walker(time):
        return robot(time)[0] + 0.5 + max(1.6 - 0.8 * time, 0.0), 3.0

    for time, seen in ScannedRoom(walkers=[walker], robot=robot).run(20.0):
        if time > 1.0:
            (track,) = seen.tracks
            assert math.dist((track.x, track.y), walker(time)) < 0.1


def test_nobody_is_expected_in_the_robot():
    """He walks into it from behind, where no beam shows that he has to stop."""
    walker = straight(4.0, 5.4, 0.6, -0.72, end=2.85)
    room = ScannedRoom(walkers=[walker], robot=lambda _: (6.0, 3.0, 0.0))
    tracks = [each for _, seen in room.run(7.0) for each in seen.tracks]
    away = [math.dist((each.x, each.y), (6.0, 3.0)) for each in tracks]
    assert 0.38 < min(away) < 0.6


@pytest.mark.parametrize('bearing', [-0.5, 0.0, 0.5])
@pytest.mark.parametrize('spacing', [0.3, 0.4, 0.5, 0.6])
def test_who_comes_to_stand_beside_somebody_at_the_robot_is_another(spacing, bearing):
    """He is seen where the first one, who has long stood there, nearly is."""
    half = math.asin(spacing / 2.0 / 0.55)
    (first_x, first_y), (second_x, second_y) = (
        (1.8 + 0.55 * math.cos(each), 3.0 + 0.55 * math.sin(each))
        for each in (bearing + half, bearing - half)
    )

    def first(time):
        return first_x + max(2.0 - 0.8 * time, 0.0), first_y

    def second(time):
        return second_x + max(8.0 - 1.3 * time, 0.0), second_y

    room = ScannedRoom(walkers=[first, second], robot=lambda _: (1.8, 3.0, 0.0))
    for time, seen in room.run(12.0):
        if time > 6.5:
            for x, y in (first(time), second(time)):
                away = [math.dist((each.x, each.y), (x, y)) - each.radius for each in seen.tracks]
                assert min(away) < -0.05
