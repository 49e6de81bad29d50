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
from cmpsp_ros.guidance.planning import initial_guess, manoeuvres
from cmpsp_ros.guidance.planning.reeds_shepp import has_to_turn, length_of, shortest_paths
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world import FreeSpace
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


places = st.floats(-6.0, 6.0)
angles = st.floats(-math.pi, math.pi)


def end_of(path):
    x = y = heading = 0.0
    for turn, length in path:
        if turn == 0:
            x, y = x + length * math.cos(heading), y + length * math.sin(heading)
            continue
        after = heading + turn * length
        x += turn * (math.sin(after) - math.sin(heading))
        y -= turn * (math.cos(after) - math.cos(heading))
        heading = after
    return x, y, heading


@given(places, places, angles)
def test_every_path_ends_at_the_pose(x, y, heading):
    paths = shortest_paths(x, y, heading)
    assert paths
    for path in paths:
        end_x, end_y, end_heading = end_of(path)
        assert math.dist((end_x, end_y), (x, y)) < 1e-6
        assert abs(math.remainder(end_heading - heading, math.tau)) < 1e-6
    lengths = [length_of(path) for path in paths]
    assert lengths == sorted(lengths)


@given(places, places, angles)
def test_the_way_back_is_as_long(x, y, heading):
    cosine, sine = math.cos(heading), math.sin(heading)
    back = shortest_paths(-(x * cosine + y * sine), x * sine - y * cosine, -heading)
    assert length_of(back[0]) == pytest.approx(
        length_of(shortest_paths(x, y, heading)[0]), abs=1e-6
    )


@pytest.mark.parametrize(
    ('pose', 'length'),
    [
        ((3.0, 0.0, 0.0), 3.0),
        ((-3.0, 0.0, 0.0), 3.0),
        ((1.0, 1.0, math.pi / 2.0), math.pi / 2.0),
        # Turning round on the spot: three arcs of 60 degrees.
        ((0.0, 0.0, math.pi), math.pi),
    ],
)
def test_known_lengths(pose, length):
    assert length_of(shortest_paths(*pose)[0]) == pytest.approx(length, abs=1e-9)


def course(preset, **changes):
    values = TABLE.resolve({**load_parameter_file(preset), **changes})
    settings = guidance_settings(values)
    start = PlanStart(np.array(values['initial_pose']), settings.robot, settings.world)
    steps = round(settings.final_time / settings.control_period)
    return settings, start, np.full(steps, settings.control_period)


@pytest.mark.parametrize('heading', [math.pi / 2.0, -math.pi / 2.0])
def test_into_a_bay_in_either_direction(heading):
    settings, start, durations = course('parking', **{'goal.heading': [heading]})
    assert has_to_turn(start, settings.target)
    guesses = manoeuvres(settings, start, settings.target, durations)
    space = FreeSpace.of(settings.road, settings.obstacles, settings.robot_radius)
    poses = settings.robot.roll_out(start.pose, guesses[0][:-1], durations)
    distance, off = settings.target.errors(poses[-1])
    assert distance < 1e-9
    assert off < 1e-9
    assert space.at(poses).min() > 0.0
    assert np.abs(guesses[0]).max(axis=0)[1] <= settings.robot.max_steering_angle
    # A start in reverse is among them, or a way that is driven so in parts.
    assert any((each[:, 0] < 0.0).any() for each in guesses)


def test_a_car_that_faces_the_wrong_way_turns_round_and_follows_the_road():
    settings, start, durations = course(
        'lane_change', initial_pose=[10.0, 0.0, math.pi], final_time=20.0
    )
    assert has_to_turn(start, settings.target)
    guesses = manoeuvres(settings, start, settings.target, durations)
    for guess in guesses:
        assert guess.shape == (201, 2)
        end = settings.robot.roll_out(start.pose, guess[:-1], durations)[-1]
        assert end[0] > 40.0


def test_who_faces_ahead_or_turns_on_the_spot_needs_none():
    settings, start, _ = course('lane_change')
    assert not has_to_turn(start, settings.target)
    settings, start, _ = course('case3', initial_pose=[0.0, -9.25, math.pi])
    assert not has_to_turn(start, settings.target)


def test_without_time_there_is_none():
    settings, start, durations = course('parking')
    assert manoeuvres(settings, start, settings.target, durations[:1]) == []
