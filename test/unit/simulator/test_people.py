"""People on foot: where they walk, how fast they change, and what makes them stop."""

import math

import numpy as np
import pytest

from cmpsp_ros.simulator import People, PeopleSettings, Walker, discs_of, edges_of
from cmpsp_ros.world.obstacles import Capsule, Obstacle

STEP = 20_000_000
FAR = np.array([[50.0, 50.0]])
CORNERS = [(0.0, 0.0), (8.0, 0.0), (8.0, 5.0), (0.0, 5.0)]
WALLS = [Capsule(f'w{k}', one, CORNERS[(k + 1) % 4], 0.05) for k, one in enumerate(CORNERS)]
PILLAR = Obstacle('pillar', (5.0, 2.5), 0.4)


def walk(people, seconds, robot=FAR, radius=0.3):
    """States at each step, shape (K, P, 5)."""
    people.begin(0)
    states = []
    for number in range(1, round(seconds * 1e9 / STEP) + 1):
        people.advance(number * STEP, robot, radius)
        states.append(people.at(number * STEP))
    return np.array(states)


def in_a_room(*walkers, **rest):
    return People(PeopleSettings(walkers, **rest), edges_of(WALLS), discs_of([*WALLS, PILLAR]))


def crowd():
    random = [Walker(f'r{k}', (1.0 + k, 1.0), 'random', speed=1.2) for k in range(5)]
    straight = [
        Walker(f's{k}', (1.5, 2.8 + 0.6 * k), heading=0.7 * k, speed=0.6 + 0.3 * k, gives_way=False)
        for k in range(4)
    ]
    return in_a_room(*random, *straight, acceleration=1.0, seed=3)


def test_nobody_walks_through_walls_or_people_or_accelerates_too_much():
    states = walk(crowd(), 60.0)
    away = np.hypot(*(states[..., :2] - PILLAR.center).transpose(2, 0, 1)) - PILLAR.radius
    inside = np.minimum(states[..., 0], 8.0 - states[..., 0])
    inside = np.minimum(inside, np.minimum(states[..., 1], 5.0 - states[..., 1]))
    assert inside.min() > 0.1
    assert away.min() > 0.1
    one, other = np.triu_indices(states.shape[1], 1)
    apart = np.hypot(*(states[:, one, :2] - states[:, other, :2]).transpose(2, 0, 1))
    assert (apart - states[:, one, 4] - states[:, other, 4]).min() > -0.01
    changes = np.hypot(*np.diff(states[..., 2:4], axis=0).transpose(2, 0, 1)) / (STEP / 1e9)
    assert np.quantile(changes, 0.999) <= 1.0 + 1e-9
    assert np.hypot(*states[..., 2:4].transpose(2, 0, 1)).max() <= 1.5 + 1e-9
    # Everybody gets about.
    assert np.ptp(states[..., :2], axis=0).max(axis=1).min() > 1.0


def test_the_same_seed_walks_the_same_paths_and_a_reset_begins_again():
    people = crowd()
    states = walk(people, 10.0)
    np.testing.assert_array_equal(states, walk(crowd(), 10.0))
    people.reset()
    np.testing.assert_array_equal(states, walk(people, 10.0))


def test_they_stand_until_they_begin():
    people = in_a_room(Walker('a', (2.0, 2.5)))
    people.advance(STEP, FAR, 0.3)
    np.testing.assert_array_equal(people.at(STEP), [[2.0, 2.5, 0.0, 0.0, 0.25]])


def test_waypoints_are_visited_there_and_back():
    path = (4.0, 1.0, 4.0, 4.0)
    states = walk(in_a_room(Walker('a', (1.0, 1.0), 'waypoints', waypoints=path, speed=1.5)), 20.0)
    for point in ((4.0, 1.0), (4.0, 4.0), (1.0, 1.0)):
        assert np.hypot(*(states[100:, 0, :2] - point).T).min() < 0.3


@pytest.mark.parametrize('gives_way', [True, False])
def test_a_robot_in_the_way_is_avoided_or_bumped_into_but_never_entered(gives_way):
    people = in_a_room(Walker('a', (1.0, 1.0), speed=1.0, gives_way=gives_way))
    states = walk(people, 6.0, np.array([[4.0, 1.0]]), 0.3)
    gap = np.hypot(*(states[:, 0, :2] - (4.0, 1.0)).T) - 0.55
    assert gap.min() > 0.0 if gives_way else -0.03 < gap.min() <= 0.0


def test_two_people_who_walk_straight_at_each_other_brake_and_turn_round():
    people = in_a_room(
        Walker('a', (1.0, 1.2), speed=1.0, gives_way=False),
        Walker('b', (7.0, 1.2), heading=math.pi, speed=1.0, gives_way=False),
        acceleration=1.0,
    )
    states = walk(people, 8.0)
    gap = states[:, 1, 0] - states[:, 0, 0] - 0.5
    assert 0.0 < gap.min() < 0.2
    assert gap[-1] > 2.0
    changes = np.abs(np.diff(states[..., 2], axis=0)) / (STEP / 1e9)
    assert changes.max() <= 1.0 + 1e-9


def test_two_people_who_give_way_pass_each_other():
    states = walk(
        in_a_room(
            Walker('a', (1.0, 1.2), speed=1.0), Walker('b', (7.0, 1.2), heading=math.pi, speed=1.0)
        ),
        6.0,
    )
    gap = np.hypot(*(states[:, 0, :2] - states[:, 1, :2]).T) - 0.5
    assert gap.min() > 0.0
    assert states[:, 0, 0].max() > 6.0


def test_a_group_stays_together():
    states = walk(in_a_room(Walker('g', (1.5, 3.0), heading=0.1, speed=0.8, count=3)), 5.0)
    spread = np.hypot(*(states[:, 1:, :2] - states[:, :1, :2]).transpose(2, 0, 1))
    assert states.shape[1] == 3
    assert spread.max() < 1.5


def test_legs_stay_under_the_body_and_move_in_turn():
    people = in_a_room(Walker('a', (1.0, 1.0), speed=1.0), legs=True)
    walk(people, 3.0)
    stamps = np.arange(60, 140) * STEP
    bodies = np.array([people.at(each)[0] for each in stamps])
    legs = np.array([people.visible_at(each) for each in stamps])
    away = np.hypot(*(legs[..., :2] - bodies[:, None, :2]).transpose(2, 0, 1))
    assert legs.shape[1:] == (2, 5)
    assert away.max() < bodies[0, 4]
    speeds = legs[..., 2]
    assert speeds.min() < 0.4
    assert speeds.max() > 1.6
    # A foot's velocity is that of its place.
    rates = np.diff(legs[..., 0], axis=0) / (STEP / 1e9)
    np.testing.assert_allclose(rates, (speeds[1:] + speeds[:-1]) / 2.0, atol=0.02)
