"""Guesses to start from: along the road, within the limits, to the goal."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scenarios import CASES, ROAD, settings, start_of

from cmpsp_ros.guidance import InitialGuess, SolverSettings
from cmpsp_ros.guidance.planning import initial_guess
from cmpsp_ros.world.roads import Annulus

unhurried = hypothesis_settings(deadline=None, max_examples=40)
TIMES = np.full(50, 0.2)


def path_of(given, pose, times=TIMES):
    controls = initial_guess(given, start_of(given, pose), given.target, times)
    assert controls.shape == (len(times) + 1, 2)
    assert np.isfinite(controls).all()
    assert np.abs(controls).max() <= given.robot.max_wheel_speed
    return given.robot.roll_out(np.array(pose), controls, times)


def test_constant_guess_is_what_was_asked_for():
    guess = InitialGuess('constant', (12.0, -3.0))
    given = settings(guess=guess)
    start = start_of(given, np.zeros(3))
    controls = initial_guess(given, start, given.target, np.full(4, 0.2))
    np.testing.assert_array_equal(controls, np.tile([12.0, -3.0], (5, 1)))


@pytest.mark.parametrize('limit', [math.inf, 51.0])
@pytest.mark.parametrize('onward', [1.0, -1.0])
@unhurried
@given(
    radius=st.floats(9.5, 10.5),
    bearing=st.floats(0.9, 1.6),
    off=st.floats(-0.2, 0.2),
    turn=st.floats(-3.0, 3.0),
)
def test_road_guess_stays_on_the_road_and_ends_at_the_goal(
    limit, onward, radius, bearing, off, turn
):
    """Both ways round, at any place of a road that is not at the origin."""
    given = settings(limit=limit, guess=ROAD)
    center = np.array([3.0, -2.0])
    goal = center + 10.0 * np.array([math.cos(turn), math.sin(turn)])
    given = replace(given, road=Annulus(tuple(center)), goal=tuple(goal))
    angle = turn - onward * bearing
    start = [
        *(center + radius * np.array([math.cos(angle), math.sin(angle)])),
        angle + onward * math.pi / 2.0 + off,
    ]
    path = path_of(given, start)
    on_road = np.linalg.norm(path[:, :2] - center, axis=1)
    assert on_road.min() > 9.0
    assert on_road.max() < 11.0
    assert math.dist(path[-1, :2], goal) < 0.5


def test_road_guess_takes_the_shorter_way_round():
    left = path_of(settings(guess=ROAD, goal=(0.0, 10.0)), (10.0, 0.5, math.pi / 2))
    right = path_of(settings(guess=ROAD, goal=(0.0, -10.0)), (10.0, -0.5, -math.pi / 2))
    assert (np.diff(np.arctan2(left[:, 1], left[:, 0])) > 0.0).all()
    assert (np.diff(np.arctan2(right[:, 1], right[:, 0])) < 0.0).all()
    np.testing.assert_allclose(left[:, 1], -right[:, 1], atol=1e-9)


def test_road_guess_turns_no_faster_than_trusted():
    given = settings(guess=ROAD)
    for trusted in (0.2, 0.6):
        one = replace(given, solver=SolverSettings(heading_trust_region=trusted))
        path = path_of(one, (0.0, -9.25, math.pi))
        assert np.abs(np.diff(path[:, 2])).max() <= trusted + 1e-9
    free = replace(given, solver=SolverSettings(heading_trust_region=0.0))
    assert np.isfinite(path_of(free, (0.0, -9.25, math.pi))).all()


@pytest.mark.parametrize('name', CASES)
@pytest.mark.parametrize(
    'pose',
    [
        (10.0, 0.0, math.pi / 2),
        (0.0, 0.0, 0.0),
        (-10.0, 0.0, 0.0),
        (-10.0, -0.0, 0.0),
        (50.0, 50.0, 100.0),
    ],
)
@pytest.mark.parametrize('steps', [1, 2, 50])
def test_guess_is_finite_from_anywhere(name, pose, steps):
    path_of(replace(CASES[name], initial_guess=ROAD), pose, np.full(steps, 0.2))
