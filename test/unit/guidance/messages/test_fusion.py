"""Tracks of several sources: one for each object, whoever saw it."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from cmpsp_ros.guidance.messages import PeerTrajectory, Track, TrackFusion, without_robots

SECOND = 1_000_000_000
SEEN, OTHERS = Track.SEEN, 2 * Track.SEEN


def track(number, x, y=0.0, vx=0.0, vy=0.0, *, stamp=SECOND, stddevs=(0.05, 0.1), radius=0.3):
    return Track(number, stamp, radius, x, y, vx, vy, *stddevs)


def ids(tracks):
    return [each.id for each in tracks]


def test_one_object_is_one_track_and_what_is_told_counts_as_exact():
    told = track(7, 1.0, 0.0, 0.8, stddevs=(0.0, 0.0))
    seen = [track(SEEN + 1, 1.05, 0.1, 0.7, 0.1), track(SEEN + 2, 5.0)]
    others = [track(OTHERS + 3, 5.1, 0.05), track(OTHERS + 4, -3.0, stddevs=(0.3, 0.5))]
    fused = TrackFusion().update(SECOND, ([told], seen, others))
    assert fused == [told, seen[1], others[1]]


def test_the_surer_track_is_kept_and_stays_until_another_is_clearly_surer():
    fusion = TrackFusion()
    one, other = track(SEEN + 1, 2.0), track(OTHERS + 1, 2.0, stddevs=(0.2, 0.2))
    for stddev in (0.2, 0.04, 0.02):
        now = replace(other, position_stddev=stddev, velocity_stddev=0.1)
        assert ids(fusion.update(SECOND, ([], [one], [now]))) == [SEEN + 1]
    sure = replace(other, position_stddev=0.02, velocity_stddev=0.04)
    assert ids(fusion.update(SECOND, ([], [one], [sure]))) == [OTHERS + 1]
    less = replace(other, position_stddev=0.1, velocity_stddev=0.15)
    assert ids(fusion.update(SECOND, ([], [one], [less]))) == [OTHERS + 1], 'it stays, too'
    assert ids(fusion.update(SECOND, ([], [one], []))) == [SEEN + 1]


def test_a_track_that_is_old_is_brought_to_the_time_and_is_less_sure():
    old = track(7, 0.0, 0.0, 1.0, stamp=0, stddevs=(0.0, 0.0))
    seen = track(SEEN + 1, 1.0, 0.0, 1.0)
    assert TrackFusion().update(SECOND, ([old], [seen])) == [seen]
    assert TrackFusion().update(SECOND, ([replace(old, stamp=SECOND, x=1.0)], [seen]))[0].id == 7


@pytest.mark.parametrize(
    ('one', 'other'),
    [
        (track(1, 0.0, 0.0, 0.8), track(SEEN + 1, 0.3, 0.0, -0.8)),
        (track(1, 0.0), track(SEEN + 1, 0.35, stddevs=(0.5, 0.5))),
        (track(1, 0.0), track(SEEN + 1, 0.2, 0.0, 1.5)),
    ],
    ids=['they pass each other', 'they stand side by side', 'one overtakes the other'],
)
def test_two_objects_stay_two(one, other):
    assert len(TrackFusion().update(SECOND, ([one], [other]))) == 2


@pytest.mark.parametrize(
    ('other', 'covered'),
    [
        (track(OTHERS + 1, 3.6, 0.0, 0.8), False),
        (track(OTHERS + 1, 4.0, 1.3, 0.7), False),
        (track(OTHERS + 1, 4.3, 0.2, 0.7, radius=1.3), True),
    ],
    ids=['a part of it', 'somebody beside it', 'all of it'],
)
def test_a_vehicle_is_not_lost_behind_a_surer_track_of_less(other, covered):
    vehicle = track(SEEN + 1, 4.0, 0.0, 0.8, stddevs=(0.1, 0.2), radius=1.44)
    fusion = TrackFusion()
    for _ in range(2):
        fused = fusion.update(SECOND, ([], [vehicle], [other]))
        assert fused == ([other] if covered else [other, vehicle])


def test_a_pair_stays_together_that_would_not_be_made():
    one, other = track(SEEN + 1, 0.0), track(OTHERS + 1, 0.45, 0.0, 0.5)
    assert len(TrackFusion().update(SECOND, ([one], [other]))) == 2
    fusion = TrackFusion()
    assert len(fusion.update(SECOND, ([one], [replace(other, x=0.1, vx=0.1)]))) == 1
    assert len(fusion.update(SECOND, ([one], [other]))) == 1


def test_two_people_side_by_side_are_each_found_again_in_any_order():
    first = [track(1, 0.0, 0.0, 0.5), track(2, 0.4, 0.0, 0.5)]
    second = [track(SEEN + 1, 0.05, 0.02, 0.45), track(SEEN + 2, 0.42, -0.02, 0.5)]
    for some, others in zip(permutations(first), permutations(second), strict=True):
        for left, right in ((some, others), (others, some)):
            assert len(TrackFusion().update(SECOND, (left, right))) == 2


def test_crowds_of_three_sources_are_one_crowd():
    generator = np.random.default_rng(3)
    for _ in range(50):
        grid = np.array([(x, y) for x in range(5) for y in range(4)], dtype=float)
        places = grid * 0.9 + generator.uniform(-0.1, 0.1, grid.shape)
        velocities = generator.normal(0.0, 0.6, grid.shape)
        sources = []
        for number in range(3):
            noise = generator.normal(0.0, 0.05, (2, *grid.shape))
            seen = generator.random(len(grid)) < 0.8
            states = np.hstack([places + noise[0], velocities + noise[1]])[seen]
            numbers = number * SEEN + np.flatnonzero(seen)
            sources.append(
                [track(int(k), *each) for k, each in zip(numbers, states.tolist(), strict=True)]
            )
        fused = TrackFusion().update(SECOND, sources)
        there = {each.id % SEEN for tracks in sources for each in tracks}
        assert sorted(each.id % SEEN for each in fused) == sorted(there)


def test_what_is_seen_of_a_robot_whose_plan_is_known_is_no_track():
    plan = PeerTrajectory('/r2', 0, (0, 2 * SECOND), ((0.0, 0.0), (2.0, 0.0)))
    seen = [track(SEEN + 1, 1.1), track(SEEN + 2, 1.6)]
    assert without_robots(seen, [plan], 0.3, SECOND) == seen[1:]
    assert without_robots(seen, [], 0.3, SECOND) == seen


def test_points_of_nothing():
    point = track(1, 0.0, stddevs=(0.0, 0.0), radius=0.0)
    fused = TrackFusion().update(SECOND, ([point], [replace(point, id=SEEN + 1)]))
    assert ids(fused) == [1]
    assert TrackFusion().update(SECOND, ([], [], [])) == []
