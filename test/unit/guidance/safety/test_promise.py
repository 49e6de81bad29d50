"""The promise: moving obstacles within their limits never touch the robot while it moves."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example
from hypothesis import given as with_random
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scenarios import assert_is
from walkers import Walker, drive

from cmpsp_ros.guidance import (
    FallbackLevel,
    GuidanceLaw,
    GuidanceSettings,
    MovingObstacles,
    Observation,
    Safety,
)
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.prediction.obstacle_tracker import reachable_sets
from cmpsp_ros.guidance.safety import plan_clearance
from cmpsp_ros.parameters.files import load_robot
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.obstacles import Capsule, MovingDiscs
from cmpsp_ros.world.roads import OpenFloor

ROBOTS = {'turtlebot': 'turtlebot4', 'jackal': 'jackal'}
PROMPT, LIMITED, LATE = (math.inf, 0.0, 0.0), (1.5, 0.0, 0.0), (1.5, 0.1, 0.1)


def room(x0, y0, x1, y1):
    """Four walls."""
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    ends = zip(corners, corners[1:] + corners[:1], strict=True)
    return tuple(Capsule(f'wall {k}', *each, 0.05) for k, each in enumerate(ends))


def settings(name, walls, goal, acceleration, seconds, delay=0.0, lag=0.0):
    """A task of a robot that can be bought, among people."""
    robot, radius = bought(name)
    limit = acceleration / robot.wheel_radius
    return GuidanceSettings(
        robot=replace(robot, max_wheel_acceleration=limit),
        road=OpenFloor(),
        obstacles=walls,
        goal=goal,
        final_time=seconds,
        may_be_late=True,
        goal_tolerance=0.1,
        robot_radius=radius,
        command_delay=delay,
        max_lag=0.3 if lag else 0.0,
        moving_obstacles=MovingObstacles(capacity=8),
        safety=Safety(margin=0.05),
    )


def bought(name):
    """Robot and radius of a parameter file."""
    values = load_robot(ROBOTS[name])
    keys = 'wheel_radius', 'half_track', 'max_wheel_speed'
    return DifferentialDrive(**{key: values[f'robot.{key}'] for key in keys}), values[
        'robot.radius'
    ]


angles = st.floats(-math.pi, math.pi)
people = st.builds(
    lambda away, bearing, speed, heading, push, turn: (away, bearing, speed, heading, push, turn),
    st.floats(0.9, 4.0),
    angles,
    st.floats(0.0, 1.6),
    st.none() | angles,
    st.sampled_from([0.0, 0.5, 1.0]),
    st.floats(-3.0, 3.0),
)


def walker(start, away, bearing, speed, heading, push, turn):
    """One who walks at the robot, or anywhere, and is accelerated in a direction that turns."""
    heading = bearing + math.pi if heading is None else heading
    return Walker(
        start[0] + away * math.cos(bearing),
        start[1] + away * math.sin(bearing),
        speed * math.cos(heading),
        speed * math.sin(heading),
        push=lambda time: (push * math.cos(heading + turn * time), push * math.sin(turn * time)),
    )


@pytest.mark.parametrize('limits', [PROMPT, LIMITED, LATE], ids=['prompt', 'limited', 'late'])
@pytest.mark.parametrize('name', ROBOTS)
@hypothesis_settings(max_examples=12, deadline=None)
@with_random(st.lists(people, min_size=1, max_size=4))
def test_nothing_touches_a_robot_that_moves(name, limits, crowd):
    acceleration, delay, lag = limits
    task = settings(name, room(-3, -3, 9, 3), (8.0, 0.0), acceleration, 12.0, delay, lag)
    walkers = [walker((0.0, 0.0), *each) for each in crowd]
    run = drive(task, (0.0, 0.0, 0.0), walkers, 4.0, delay, lag)
    assert run.active == []


CLOSED = room(-12.0, -1.1, 16.0, 1.1)
NICHE = (
    *CLOSED[1:],
    Capsule('south west', (-12.0, -1.1), (0.0, -1.1), 0.05),
    Capsule('south east', (1.4, -1.1), (16.0, -1.1), 0.05),
    Capsule('west of it', (0.0, -1.1), (0.0, -2.5), 0.05),
    Capsule('east of it', (1.4, -1.1), (1.4, -2.5), 0.05),
    Capsule('end of it', (0.0, -2.5), (1.4, -2.5), 0.05),
)


def abreast(x, speed):
    """Three who close the aisle."""
    return [Walker(x, y, -speed, 0.0, 0.33) for y in (-0.7, 0.0, 0.7)]


def test_it_backs_off_from_what_closes_the_aisle(fault):
    task = settings('jackal', CLOSED, (12.0, 0.0), 2.0, 30.0)
    run = drive(task, (2.0, 0.0, 0.0), abreast(9.0, 0.5), 16.0)
    assert (run.active, run.passive) == ([], 0)
    assert run.path[-1][0] < 0.5
    backs_off = [each for each in run.decisions if 'makes way' in each.reason]
    assert_is(fault, backs_off[0])


def test_it_steps_into_a_niche_and_goes_on_when_the_trolley_has_passed(fault):
    task = settings('jackal', NICHE, (12.0, 0.0), 2.0, 30.0)
    trolley = [Walker(9.0 + x, y, -0.5, 0.0, 0.45) for x in (0.0, 0.5) for y in (-0.5, 0.5)]
    run = drive(task, (2.0, 0.0, 0.0), trolley, 45.0)
    assert (run.active, run.passive) == ([], 0)
    assert min(y for _, y, _ in run.path) < -1.1
    assert_is(fault, next(each for each in run.decisions if 'has made way' in each.reason))
    assert run.decisions[-1].terminal_error < 0.1


def test_it_does_not_wait_for_ever_for_those_who_come_and_go():
    """The trolley passes the niche; behind it three close the aisle, and walk to and fro."""
    task = settings('jackal', NICHE, (12.0, 0.0), 2.0, 9.0)
    trolley = [Walker(7.0 + x, y, -0.5, 0.0, 0.45) for x in (0.0, 0.5) for y in (-0.5, 0.5)]
    back = abreast(8.8, -0.5)
    for each in back:
        each.push = lambda time: (-0.6 * math.sin(1.2 * time), 0.0)
    run = drive(task, (2.0, 0.0, 0.0), [*trolley, *back], 24.0)
    assert run.active == []
    waits = ''.join('w' if 'has made way' in each.reason else ' ' for each in run.decisions)
    # At most the three seconds that it looks ahead.
    assert 8 <= max(map(len, waits.split())) <= 15


def test_what_is_faster_is_let_run_into_a_robot_that_stands(fault):
    task = settings('turtlebot', CLOSED, (12.0, 0.0), 1.0, 60.0)
    run = drive(task, (2.0, 0.0, 0.0), abreast(6.0, 1.5), 8.0)
    assert run.active == []
    assert run.passive > 0
    assert_is(fault, next(each for each in run.decisions if 'touches the robot' in each.reason))


def test_doubt_about_a_velocity_does_not_fill_a_long_horizon():
    task = settings('turtlebot', CLOSED, (12.0, 0.0), 1.0, 45.0)
    law = GuidanceLaw(task, task.world)
    person = Track(1, 0, 0.25, 3.0, 0.8, 0.0, 0.0, position_stddev=0.02, velocity_stddev=0.13)
    decision = law.step(Observation(0, np.zeros(3), (person,)))
    assert decision.level == FallbackLevel.NOMINAL, decision.reason
    assert decision.terminal_error < 0.1
    assert plan_clearance(task, task.world, decision).min() == pytest.approx(
        decision.worst_clearance, abs=1e-9
    )


KNOWN = MovingObstacles(capacity=4, growth=0.1)


def reach(track, stamp=0):
    """Reachable set of one track."""
    planned = MovingDiscs(('it',), np.zeros((1, 7)), np.zeros(1, np.int64))
    return reachable_sets(stamp, [track], planned, KNOWN)


def test_a_reachable_set_grows_with_doubt_and_acceleration():
    track = Track(1, 0, 0.3, 2.0, 0.0, 0.5, 0.0, position_stddev=0.02, velocity_stddev=0.1)
    centers, radii = reach(track).at_times(np.array([0.0, 1.0]))
    np.testing.assert_allclose(centers[:, 0], [[2.0, 0.0], [2.5, 0.0]])
    np.testing.assert_allclose(radii[:, 0], [0.36, 0.36 + 0.3 + 0.5])
    later = reach(track, 500_000_000).at_times(np.array([0.5]))
    np.testing.assert_allclose(later[1], [[0.36 + 0.3 + 0.5]])
    np.testing.assert_allclose(later[0][0], [[2.5, 0.0]])


@with_random(
    speed=st.floats(0.0, 1.6),
    heading=angles,
    error=st.floats(0.0, 3.0),
    error_bearing=angles,
    stddev=st.floats(0.0, 1.5),
)
@example(speed=1.5999999999999999, heading=1.0, error=3.0, error_bearing=1.0, stddev=1.5)
def test_velocities_that_are_possible_are_in_the_set(speed, heading, error, error_bearing, stddev):
    """Seen with an error within three deviations, and no faster than anything is."""
    true = speed * np.array([math.cos(heading), math.sin(heading)])
    seen = true + error * stddev * np.array([math.cos(error_bearing), math.sin(error_bearing)])
    state = reach(Track(1, 0, 0.3, 0.0, 0.0, *seen.tolist(), velocity_stddev=stddev)).states[0]
    assert math.dist(state[2:4], true) <= state[5] + 1e-9
    assert state[5] <= min(3.0 * stddev, 1.6) + 1e-9


def test_a_leg_of_a_set_that_grows_ever_faster_covers_it():
    discs = reach(Track(1, 0, 0.3, 2.0, 1.0, 0.5, 0.1, velocity_stddev=0.05))
    legs, begin = discs.legs(np.array([0.2, 0.5])), 0.0
    for leg, duration in zip(legs[:, 0], (0.2, 0.5), strict=True):
        since = np.linspace(0.0, duration, 20)
        _, radii = discs.at_times(begin + since)
        assert (leg[4] + leg[5] * since >= radii[:, 0] - 1e-12).all()
        begin += duration
