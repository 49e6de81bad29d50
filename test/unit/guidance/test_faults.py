"""Answers of the law when something is wrong with the task, the world or the solver.

Each test compares its decision with the row of doc/reference/faults.md that names it.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import (
    FIRST,
    ON_TIME,
    PERIOD,
    ROAD,
    SECOND,
    SETTLED,
    START,
    after,
    assert_is,
    clearance,
    closed_loop,
    drive,
    exhausted,
    law_of,
    reconfigure,
    settings,
)

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation, Safety
from cmpsp_ros.world.obstacles import Obstacle

COURSE = settings((FIRST, SECOND), 51.0, ROAD)
EMPTY = settings(limit=51.0, guess=ROAD)
MIDDLE = (0.0, -10.0, 0.0)
# What wheels of 51 rad/s drive straight on in a period [m].
STRIDE = 51.0 * 0.035 * 0.2


def assert_safe(run, given):
    assert clearance(run.path, given) >= -1e-9
    assert np.abs(run.controls).max() <= given.robot.max_wheel_speed


def under_way(given, steps=21):
    """A law after so many control steps, and where the robot is at the next."""
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, ON_TIME[:steps])
    return law, run, after(run, given)


def assert_comes_back(run):
    out = np.array([min(0.0, clearance(part, EMPTY)) for part in run.driven])
    assert (np.diff(out) >= -1e-9).all(), 'never further out'
    assert out[-1] == 0.0
    assert run.miss() < 1e-6


@pytest.mark.parametrize('start', [(0.0, -11.5, 0.0), (0.0, -8.5, 0.0)])
def test_started_outside_the_road(fault, start):
    run = closed_loop(EMPTY, start)
    assert_is(fault, run.decisions[0])
    assert_comes_back(run)


@pytest.mark.parametrize('start', [(0.0, -11.05, 0.3), (0.0, -8.95, -0.3)])
def test_started_a_little_outside_the_road(fault, start):
    run = closed_loop(EMPTY, start)
    assert_is(fault, run.decisions[0])
    assert_comes_back(run)


@pytest.mark.parametrize('depth', [2e-3, 0.1, 0.5])
def test_started_inside_an_obstacle(fault, depth):
    given = settings((FIRST, Obstacle('rock', (0.0, -10.5 + depth), 0.5)), 51.0, ROAD)
    law = GuidanceLaw(given, given.world)
    for stamp in ON_TIME[:5]:
        decision = law.step(Observation(stamp, np.array(MIDDLE)))
        assert_is(fault, decision)
        assert decision.reason.startswith(f'The robot is {depth:.3g} m inside obstacle rock')
        assert not decision.wheel_speeds.any()
    # It was the odometry that erred, or the obstacle has been taken away.
    assert (
        law.step(Observation(ON_TIME[5], np.array([0.0, -9.25, 0.0]))).level
        is FallbackLevel.NOMINAL
    )


@pytest.mark.parametrize('gap', [0.0, 0.001, 0.01, 0.025])
def test_started_nearer_to_an_obstacle_than_plans_keep(fault, gap):
    """The room for arcs between samples is wanted from the next sample on, not where it stands."""
    given = settings((Obstacle('rock', (0.0, -10.5 - gap), 0.5),), 51.0, ROAD)
    run = closed_loop(given, MIDDLE)
    assert_is(fault, run.decisions[0])
    assert_safe(run, given)
    assert run.miss() < 1e-6


@pytest.mark.parametrize(
    ('gap', 'heading'), [(0.0, 0.0), (0.0, 0.3), (0.02, -0.3), (0.02, 0.3), (0.08, -0.3)]
)
def test_started_inside_the_margin_of_an_obstacle(gap, heading):
    rock = Obstacle('rock', (0.0, -10.5 - gap), 0.5)
    given = settings((rock,), 51.0, ROAD, safety=Safety(margin=0.1))
    run = closed_loop(given, (0.0, -10.0, heading))
    assert_safe(run, given)
    assert {decision.level for decision in run.moves} <= SETTLED
    assert run.miss() < 1e-6
    assert clearance(run.path[400:], given) > 0.1 - 1e-3, 'kept once it has been reached'


@pytest.mark.parametrize('gap', [0.01, 0.03, 0.05])
def test_started_with_an_obstacle_at_the_nose(fault, gap):
    given = settings((Obstacle('rock', (0.5 + gap, -10.0), 0.5),), 51.0, ROAD)
    run = closed_loop(given, MIDDLE)
    assert_is(fault, run.decisions[0])
    assert_safe(run, given)
    assert run.miss() < 1e-6


WALL = Obstacle('wall', (7.07, -7.07), 1.3)


def test_road_blocked(fault):
    given = replace(EMPTY, obstacles=(WALL,))
    run = closed_loop(given)
    assert_safe(run, given)
    first = next(k for k, decision in enumerate(run.moves) if decision.level is FallbackLevel.STOP)
    for decision in run.moves[first:]:
        assert_is(fault, decision)
        assert not np.any(decision.twist)
    assert math.dist(run.pose[:2], WALL.center) < WALL.radius + 2.0 * STRIDE, 'as far as it goes'


def test_road_clear_again(fault):
    given = replace(EMPTY, obstacles=(WALL,), final_time=20.0)
    law = GuidanceLaw(given, given.world)
    blocked = drive(law, given, ON_TIME)
    assert_safe(blocked, given)
    free = replace(given, obstacles=())
    reconfigure(law, free)
    stamps = [k * PERIOD for k in range(51, 101)]
    rest = drive(law, free, stamps, start=blocked.pose)
    assert_is(fault, rest.moves[-1])
    assert_safe(rest, free)
    assert rest.miss() < 1e-3


@pytest.mark.parametrize('ahead', [3, 6, 9])
def test_obstacle_put_on_the_path(fault, ahead):
    law, run, pose = under_way(EMPTY)
    center = run.decisions[-1].plan.poses[1 + ahead, :2] + 0.05
    given = replace(EMPTY, obstacles=(Obstacle('sudden', tuple(center), 0.4),))
    reconfigure(law, given)
    rest = drive(law, given, ON_TIME[21:], start=pose)
    assert_is(fault, rest.moves[-1])
    assert_safe(rest, given)
    assert rest.miss() < 1e-6


def test_obstacle_put_before_the_wheels(fault):
    law, _, pose = under_way(EMPTY)
    forward = np.array([math.cos(pose[2]), math.sin(pose[2])])
    given = replace(EMPTY, obstacles=(Obstacle('wall', tuple(pose[:2] + 1.002 * forward), 1.0),))
    reconfigure(law, given)
    rest = drive(law, given, ON_TIME[21:], start=pose)
    assert_is(fault, rest.decisions[0])
    assert_safe(rest, given)


def shortest_way(start, goal, inner):
    """Length of the way pulled taut around a disc at the origin [m], and the way by its length."""
    out, back = math.hypot(*start), math.hypot(*goal)
    first, last = math.sqrt(out**2 - inner**2), math.sqrt(back**2 - inner**2)
    turn = math.acos(np.dot(start, goal) / out / back)
    bend = inner * (turn - math.acos(inner / out) - math.acos(inner / back))
    return first + bend + last


def test_what_no_plan_can_do_is_foretold_behind_the_first_command():
    law, pose = law_of(replace(EMPTY, final_time=5.0)), np.array(START)
    first = law.step(Observation(0, pose))
    assert law.warnings == []
    assert law.after_step().reason == f'{first.reason} {law.warnings[0]}'
    assert law.warnings[0].startswith('The goal is out of reach by ')
    second = law.step(Observation(PERIOD, pose))
    assert law.after_step() is second


def test_goal_out_of_reach(fault):
    given = replace(EMPTY, final_time=5.0)
    run = closed_loop(given, steps=25)
    for decision in run.moves:
        assert_is(fault, decision)
        assert f'ends {decision.terminal_error:.3g} m from the goal.' in decision.reason
    assert_safe(run, given)
    # Nobody could have come nearer than what is left of the shortest way when all is driven.
    left = shortest_way(START[:2], given.goal, 9.0) - 5.0 * 51.0 * 0.035
    left_of_this = shortest_way(run.pose[:2], given.goal, 9.0)
    assert left <= left_of_this < left + 0.1 * left
    assert run.decisions[-1].missed


def test_wheels_too_slow(fault):
    given = settings((FIRST, SECOND), 5.0, ROAD)
    law, pose = GuidanceLaw(given, given.world), np.array(START)
    law.step(Observation(0, pose))
    assert_is(fault, law.after_step())
    run = closed_loop(given)
    assert_safe(run, given)
    driven = math.dist(run.pose[:2], START[:2])
    assert driven > 0.9 * 5.0 * 0.035 * 10.0, 'it drives for all the time that it has'


def test_standing_on_the_goal(fault):
    given = replace(EMPTY, goal=MIDDLE[:2], final_time=4.0)
    run = closed_loop(given, MIDDLE, steps=20)
    for decision in run.moves:
        assert_is(fault, decision)
    assert np.abs(run.controls).max() < 1e-3
    assert not run.decisions[-1].missed


@pytest.mark.parametrize('behind', [0.3, 1.0, 2.0])
def test_goal_behind(fault, behind):
    given = replace(EMPTY, goal=(-behind, -10.0), final_time=4.0)
    run = closed_loop(given, MIDDLE, steps=20)
    assert_is(fault, run.moves[-1])
    assert_safe(run, given)
    assert run.miss(given.goal) < 1e-3


def test_first_heard_of_again_after_the_final_time(fault):
    law = GuidanceLaw(COURSE, COURSE.world)
    law.step(Observation(0, np.array(START)))
    decision = law.step(Observation(99 * PERIOD, np.array(START)))
    assert_is(fault, decision)
    assert decision.missed
    assert not decision.wheel_speeds.any()


def test_at_the_goal_with_another_heading_than_asked_for(fault):
    law = law_of(replace(COURSE, goal_heading=0.5))
    law.step(Observation(0, np.array(START)))
    decision = law.step(Observation(50 * PERIOD, np.array([10.0, 0.0, 1.5])))
    assert_is(fault, decision)
    assert decision.missed
    assert decision.heading_error == pytest.approx(1.0)


def test_after_the_final_time(fault):
    law = GuidanceLaw(COURSE, COURSE.world)
    run = drive(law, COURSE, ON_TIME)
    for decision in (run.decisions[-1], law.step(Observation(60 * PERIOD, run.pose))):
        assert_is(fault, decision)
        assert decision.finished
        assert not decision.missed
        assert not decision.wheel_speeds.any()


@pytest.mark.parametrize('seed', range(5))
def test_last_steps_under_noise(fault, seed):
    """Odometry with 5 mm and half a degree of noise makes no last command of three violent."""
    rng = np.random.default_rng(seed)
    law, pose, commands = GuidanceLaw(COURSE, COURSE.world), np.array(START), []
    for stamp in ON_TIME[:-1]:
        measured = pose + rng.normal(scale=[5e-3, 5e-3, math.radians(0.5)])
        decision = law.step(Observation(stamp, measured))
        commands.append(decision.wheel_speeds)
        pose = COURSE.robot.roll_out(pose, commands[-1][None], np.array([PERIOD / 1e9]))[-1]
    assert_is(fault, decision)
    assert len(decision.plan.horizon.durations) == 1
    changes = np.abs(np.diff(commands, axis=0))
    # On the way it swerves around two obstacles.
    assert changes[-3:].max() < changes[:-3].max()
    assert math.dist(pose[:2], COURSE.goal) < 0.02
    assert law.step(Observation(ON_TIME[-1], pose)).level is FallbackLevel.STOP


def test_odometry_late(fault):
    late = np.random.default_rng(1).integers(0, 90, size=51) * 1_000_000
    late[[0, 50]] = 0
    run = drive(
        GuidanceLaw(COURSE, COURSE.world), COURSE, [int(k) for k in np.array(ON_TIME) + late]
    )
    assert_is(fault, run.moves[-1])
    assert_safe(run, COURSE)
    assert run.miss() < 1e-2


def test_odometry_repeated_and_out_of_order(fault):
    law, _, pose = under_way(COURSE)
    for stamp in (ON_TIME[20], ON_TIME[19], 0, -5):
        assert law.step(Observation(stamp, np.array([5.0, 5.0, 5.0]))) is None
    undisturbed, _, _ = under_way(COURSE)
    decision, wanted = (
        law.step(Observation(ON_TIME[21], pose)),
        undisturbed.step(Observation(ON_TIME[21], pose)),
    )
    assert_is(fault, decision)
    np.testing.assert_array_equal(decision.wheel_speeds, wanted.wheel_speeds)


def test_odometry_that_jumps_to_another_place():
    law, _, _ = under_way(COURSE)
    decision = law.step(Observation(ON_TIME[21], np.array([-4.0, -9.5, 0.0])))
    assert decision.level is FallbackLevel.ELASTIC
    np.testing.assert_allclose(decision.plan.poses[0], [-4.0, -9.5, 0.0])
    assert np.abs(decision.wheel_speeds).max() <= 51.0
    assert decision.clearance >= 0.0


def test_solver_that_fails(fault):
    law, run, pose = under_way(COURSE)
    reconfigure(law, exhausted(COURSE))
    decision = law.step(Observation(ON_TIME[21], pose))
    assert_is(fault, decision)
    np.testing.assert_array_equal(decision.wheel_speeds, run.decisions[-1].plan.controls[1])


def test_solver_that_goes_on_failing(fault):
    given = replace(COURSE, failure_tolerance=3)
    law, _, pose = under_way(given)
    reconfigure(law, exhausted(given))
    rest = drive(law, given, ON_TIME[21:27], start=pose)
    assert [decision.level for decision in rest.decisions] == [FallbackLevel.PREVIOUS_PLAN] * 3 + [
        FallbackLevel.STOP
    ] * 3
    assert_is(fault, rest.decisions[-1])
    assert_safe(rest, given)
    # Once it works again the robot drives on.
    reconfigure(law, given)
    assert law.step(Observation(ON_TIME[27], rest.pose)).level in SETTLED
