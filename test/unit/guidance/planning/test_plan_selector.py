"""Several plans side by side: what is tried when, and which one is followed."""

import math
import re
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scenarios import (
    FIRST,
    ON_TIME,
    PAPER,
    PERIOD,
    ROAD,
    SECOND,
    SETTLED,
    START,
    clearance,
    closed_loop,
    drive,
    law_of,
    reconfigure,
    settings,
    with_plans,
)

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, InitialGuess, Observation
from cmpsp_ros.world.obstacles import Obstacle

BOTH = (FIRST, SECOND)


def cost(run, given):
    radius = np.linalg.norm(run.path[::40, :2] - given.road.center, axis=1)
    return given.weights.road_center / 2.0 * float(((radius - 10.0) ** 2).sum())


def assert_arrives(run, given):
    assert run.miss(given.goal) < 1e-6
    assert clearance(run.path, given) >= -1e-9
    assert len(run.moves) == 50


def compared(run):
    """Number of plans compared, by the number of the control step."""
    found = [re.findall(r'best of (\d+) plans', each.reason) for each in run.moves]
    return {k: int(each[0]) for k, each in enumerate(found, 1) if each}


# Guesses and headings of the paper's Tables 1 and 2.
GUESSES = [(45.0, 44.5), (45.0, 45.0), (18.0, 15.0), (44.5, 44.5)]
HEADINGS = [60.0, 0.0, -60.0]


STARTS = [
    *((InitialGuess('constant', each), 0.0) for each in (*GUESSES, (45.13, 44.63))),
    *((guess, heading) for guess in (ROAD, PAPER) for heading in HEADINGS),
]


@pytest.mark.parametrize(('number', 'start'), [*enumerate(STARTS)])
def test_no_guess_and_no_heading_is_a_trap(number, start):
    guess, heading = start
    given = settings(BOTH, 45.0 if number % 2 else 51.0, guess)
    run = closed_loop(given, (*START[:2], math.radians(heading)))
    assert_arrives(run, given)
    assert heading or {decision.level for decision in run.moves} <= SETTLED


def test_a_poor_plan_is_left_for_a_better_one():
    """From this guess the first plan meets every constraint, and keeps swinging to the end."""
    given = settings((), math.inf, InitialGuess('constant', (45.0, 45.0)))
    alone = drive(law_of(with_plans(given, 1, 2)), given, ON_TIME)
    run = closed_loop(given)
    assert_arrives(run, given)
    assert cost(alone, given) > 30.0
    assert cost(run, given) < 15.0
    assert 'It is the best of 2 plans.' in run.decisions[0].reason
    assert not any('Changed over' in decision.reason for decision in run.decisions)


@pytest.mark.parametrize(
    ('steps', 'radius', 'limit'), [*product((3, 8), (0.2, 0.4), (51.0,)), (5, 0.4, math.inf)]
)
def test_an_obstacle_put_in_the_middle_of_the_plan_is_passed(steps, radius, limit):
    given = settings((), limit, ROAD)
    law = GuidanceLaw(given, given.world)
    before = drive(law, given, ON_TIME[:16])
    wheels = before.decisions[-1].wheel_speeds[None]
    pose = given.robot.roll_out(before.pose, wheels, np.array([0.2]))[-1]
    center = tuple(before.decisions[-1].plan.poses[1 + steps, :2].tolist())
    blocked = replace(given, obstacles=(Obstacle('sudden', center, radius),))
    reconfigure(law, blocked)
    run = drive(law, blocked, ON_TIME[16:], start=pose)
    assert clearance(run.path, blocked) >= -1e-9
    if steps > 3 or radius < 0.4:
        assert run.miss() < 1e-6


def test_a_plan_that_ends_in_the_middle_of_an_obstacle_is_left():
    """Both sides pull alike there: no iteration gets away from it."""
    place = (10.0 * math.cos(-0.8), 10.0 * math.sin(-0.8))
    given = settings((Obstacle('post', place, 0.4),), 51.0, ROAD)
    start = (10.0 * math.cos(-1.5), 10.0 * math.sin(-1.5), math.pi / 2.0 - 1.5)
    run = closed_loop(given, start)
    assert_arrives(run, given)
    assert {decision.level for decision in run.moves} == {FallbackLevel.NOMINAL}


def test_without_obstacles_ahead_one_plan_is_improved():
    assert compared(closed_loop(settings((), 51.0, ROAD))) == {}
    counts = compared(closed_loop(settings(BOTH, 51.0, ROAD)))
    assert 0 < max(counts) <= 46


@pytest.mark.parametrize('candidates', [2, 8])
def test_no_more_plans_than_candidates(candidates):
    given = settings(BOTH, 51.0, ROAD)
    run = closed_loop(with_plans(given, candidates))
    assert_arrives(run, given)
    assert 1 < max(compared(run).values()) <= candidates


def test_where_new_plans_do_not_help_they_are_made_ever_more_seldom():
    # Far too slow to arrive in time.
    counts = compared(closed_loop(settings((), 20.0, ROAD)))
    assert list(counts)[:5] == [6, 10, 18, 26, 34]


def test_the_reason_names_the_way():
    first = law_of(settings(BOTH, 51.0, ROAD)).step(Observation(0, np.array(START)))
    assert 'the best of 4 plans, ' in first.reason
    assert ' of first and ' in first.reason
    assert first.reason.endswith(' of second.')


def test_late_odometry_uses_up_no_more_time_than_there_is():
    """Each delay costs a little of what the wheels have to spare; fresh plans win it back."""
    given, misses = settings(BOTH, 51.0, ROAD), []
    for seed in range(8):
        late = np.random.default_rng(seed).integers(0, 90, size=51) * 1_000_000
        late[[0, 50]] = 0
        stamps = [int(stamp) for stamp in np.array(ON_TIME) + late]
        run = drive(GuidanceLaw(given, given.world), given, stamps)
        assert clearance(run.path, given) >= -1e-9
        misses.append(run.miss())
    assert np.count_nonzero(np.array(misses) > 1e-3) <= 1
    assert max(misses) < 0.1


POST = (Obstacle('post', (10.0 * math.cos(-0.7), 10.0 * math.sin(-0.7)), 0.4),)
BEFORE_IT = (10.0 * math.cos(-1.4), 10.0 * math.sin(-1.4), math.pi / 2.0 - 1.4)


@pytest.mark.parametrize(
    ('obstacles', 'start', 'noise', 'seed', 'steps', 'most'),
    [
        # Straight at the middle of an obstacle: plans that are as good do not take turns.
        (POST, BEFORE_IT, 0.01, 1, 30, 1),
        # Noise puts a flaw into plans: an admissible plan is given time to mend it.
        (BOTH, START, 0.03, 0, 45, 2),
        (BOTH, START, 0.03, 2, 45, 2),
    ],
)
def test_noise_seldom_changes_the_plan(obstacles, start, noise, seed, steps, most):
    given, rng = settings(obstacles, 51.0, ROAD), np.random.default_rng(seed)
    law, pose, changes = GuidanceLaw(given, given.world), np.array(start), 0
    for k in range(steps):
        decision = law.step(Observation(k * PERIOD, pose + rng.normal(0.0, [noise] * 3)))
        changes += 'Changed over' in decision.reason
        pose = given.robot.roll_out(pose, decision.wheel_speeds[None], np.array([0.2]))[-1]
    assert changes <= most


def test_a_robot_that_gets_no_nearer_waits():
    """Before a rock as wide as the road, and a little wider."""
    given = settings((Obstacle('rock', (7.0, -7.2), 1.1),), 51.0, ROAD)
    run = closed_loop(given)
    waits = [each for each in run.moves if 'the robot waits' in each.reason.lower()]
    # In the end, where it has come as near as it can.
    assert len(waits) > 1
    assert waits[-1] is run.moves[-1]
    assert {decision.level for decision in waits} == {FallbackLevel.STOP}
    assert clearance(run.path, given) >= -1e-9


# Between an obstacle and the inner edge, facing the edge; and before two obstacles that overlap.
POCKETS = [
    ((6.316, 6.504, -2.021), (((7.123, 6.173), 0.612), ((5.013, 8.098), 0.292))),
    ((8.044, 4.351, -1.945), (((8.592, 3.801), 0.714), ((8.556, 5.973), 0.159))),
    ((5.180, 7.455, -1.578), (((5.764, 7.542), 0.502), ((2.940, 8.725), 0.589))),
    ((7.083, 6.039, 0.062), (((7.914, 6.150), 0.553), ((7.558, 5.268), 0.715))),
]


@pytest.mark.parametrize(('start', 'discs'), POCKETS)
def test_where_there_is_no_room_to_drive_in_a_bow_the_robot_turns_on_the_spot_first(start, discs):
    found = tuple(Obstacle(f'o{i}', center, radius) for i, (center, radius) in enumerate(discs))
    given = settings(found, 51.0, ROAD)
    run = closed_loop(given, start)
    assert_arrives(run, given)
    assert {decision.level for decision in run.moves} <= SETTLED


def test_where_hardly_any_time_is_left_a_plan_cuts_short():
    """The wheels turn 17.85 m in ten seconds, 17.36 m are needed; an obstacle is beside."""
    given = settings((Obstacle('beside', (10.054, 0.630), 0.131),), 51.0, ROAD)
    assert_arrives(closed_loop(given, (-2.914, 9.282, 1.117)), given)
