"""Fallback levels of the law when no new plan will do, and stops."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scenarios import (
    CASES,
    MS,
    ON_TIME,
    PERIOD,
    ROAD,
    SETTLED,
    START,
    after,
    clearance,
    drive,
    exhausted,
    law_of,
    reconfigure,
    settings,
)
from tight_places import task

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation, Plan, remaining
from cmpsp_ros.guidance.commands.fallback import Fallback
from cmpsp_ros.guidance.planning import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.guidance.state import Lateness
from cmpsp_ros.world.obstacles import Obstacle


def test_failure_at_the_very_first_step_stops():
    law = law_of(exhausted(CASES['case 1']))
    decision = law.step(Observation(0, np.array(START)))
    assert decision.level is FallbackLevel.STOP
    assert decision.failures == 1
    assert decision.terminal_error == pytest.approx(math.hypot(10.0, 9.25))


@pytest.mark.parametrize(
    ('ahead', 'radius', 'limit'),
    [
        *product((0.45, 1.0), (0.1, 0.3, 1.2), (51.0,)),
        *((0.45, 0.3, math.inf), (1.0, 1.2, math.inf)),
    ],
)
def test_an_obstacle_put_on_the_plan_is_never_touched(ahead, radius, limit):
    given = settings(limit=limit)
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, ON_TIME[:21])
    pose = after(run, given)
    forward = np.array([math.cos(pose[2]), math.sin(pose[2])])
    # Its edge is `ahead` of the robot, straight on.
    center = tuple(pose[:2] + (ahead + radius) * forward)
    blocked = replace(given, obstacles=(Obstacle('sudden', center, radius),))
    reconfigure(law, blocked)
    rest = drive(law, blocked, ON_TIME[21:], start=pose)
    assert clearance(rest.path, blocked) >= -1e-9
    assert np.abs(rest.controls).max() <= limit
    for decision in rest.moves:
        if decision.level is FallbackLevel.STOP:
            assert decision.plan is None
            assert not decision.wheel_speeds.any()
            why = 'too close to obstacle sudden', 'The robot waits: no plan', 'is closed at'
            said = (*why, 'There was no progress')
            assert any(each in decision.reason for each in said) or decision.failures


def test_halt():
    given = CASES['case 3']
    law = GuidanceLaw(given, given.world)
    early = law.halt(5, 'Nothing heard yet.')
    assert early.level is FallbackLevel.STOP
    assert early.reason == 'Nothing heard yet.'
    run = drive(law, given, ON_TIME[:11])
    stop = law.halt(10 * PERIOD + 5, 'Odometry is stale.')
    assert stop.level is FallbackLevel.STOP
    assert stop.reason == 'Odometry is stale.'
    assert not stop.wheel_speeds.any()
    assert not stop.twist.any()
    assert stop.plan is None
    assert not stop.finished
    assert stop.time_left == pytest.approx(8.0, abs=1e-6)
    # It goes on from where it stands, from a fresh guess.
    onward = law.step(Observation(12 * PERIOD, run.pose))
    assert onward.level in SETTLED
    assert onward.step == 11


def test_odometry_from_before_a_halt_is_not_decided_on():
    given = CASES['case 3']
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, ON_TIME[:11])
    law.halt(10 * PERIOD + 5, 'Odometry is stale.')
    assert law.step(Observation(8 * PERIOD, run.pose)) is None
    assert law.step(Observation(10 * PERIOD, run.pose)) is None


def test_the_previous_plan_is_not_continued_beyond_its_end():
    given = task((3.0, 0.0), Obstacle('rock', (0.0, 5.0), 0.5), when='soonest')
    old, later = remaining(0, PERIOD, 20 * PERIOD), remaining(PERIOD, PERIOD, 100 * PERIOD)
    controls = np.full((len(old.edges), 2), 5.0)
    poses = given.robot.roll_out(np.zeros(3), controls[:-1], old.durations)
    start = PlanStart(poses[1], given.robot, given.world, previous_control=controls[0])
    fallback = Fallback(given, Validator(given))

    context = PlanningContext(given, start, given.target, later)
    found, _ = fallback.shifted(Plan(old, controls, poses, 0), context)

    assert found.horizon.edges[-1] == old.edges[-1]
    np.testing.assert_allclose(found.poses[-1], poses[-1], atol=1e-9)


CASE_3 = CASES['case 3']
TOOK = 0.62


@pytest.fixture
def late():
    """A law whose second step took three periods and was not sent; and where the robot is."""
    law = GuidanceLaw(CASE_3, CASE_3.world)
    first = law.step(Observation(0, np.array(START)))
    pose = CASE_3.robot.roll_out(np.array(START), first.wheel_speeds[None], np.array([0.2]))[-1]
    second = law.step(Observation(PERIOD, pose))
    withdrawn = law.after_step(TOOK)
    # The command before goes on meanwhile.
    pose = CASE_3.robot.roll_out(pose, first.wheel_speeds[None], np.array([TOOK]))[-1]
    return law, second, withdrawn, pose


def test_a_late_plan_goes_on_shifted_by_the_time_that_it_took(late):
    law, second, withdrawn, pose = late
    assert withdrawn.late == TOOK
    assert withdrawn.reason.startswith('It took 0.62 s and was not sent, for it came too late. ')
    stamp = PERIOD + 640 * MS
    decision = law.step(Observation(stamp, pose))
    assert decision.reason.startswith('The computer was late, by 0.62 s: its last plan goes on.')
    assert (decision.level, decision.iterations) == (FallbackLevel.PREVIOUS_PLAN, 0)
    # 0.64 s later the plan holds its fourth pair; here it is slowed.
    np.testing.assert_array_equal(decision.plan.controls[0], second.plan.controls[3])
    np.testing.assert_array_equal(decision.wheel_speeds, 0.5 * second.plan.controls[3])
    np.testing.assert_array_equal(decision.plan.poses[0], pose)
    after = law.step(Observation(stamp + PERIOD, decision.plan.poses[1]))
    assert after.iterations == CASE_3.solver.iterations_per_step


def test_a_late_plan_that_is_not_clear_any_more_is_a_stop_and_a_start_for_the_next(late):
    law, _, _, pose = late
    ahead = pose[:2] + 0.25 * np.array([np.cos(pose[2]), np.sin(pose[2])])
    reconfigure(law, replace(CASE_3, obstacles=(Obstacle('box', tuple(ahead), 0.2),)))
    decision = law.step(Observation(PERIOD + 640 * MS, pose))
    assert (decision.level, decision.iterations) == (FallbackLevel.STOP, 0)
    assert decision.reason == (
        'The computer was late, by 0.62 s: its last plan is not clear any more.'
    )
    assert law.step(Observation(PERIOD + 840 * MS, pose)).iterations > 0


def test_newer_odometry_is_decided_on_at_once(late):
    law, second, _, pose = late
    assert law.is_due(second.stamp + 1)
    assert law.step(Observation(second.stamp + 1, pose)) is not None


def test_a_command_that_was_not_sent_is_not_foreseen_either():
    given = replace(CASE_3, command_delay=0.1)
    law = GuidanceLaw(given, given.world)
    first = law.step(Observation(0, np.array(START)))
    pose = given.robot.roll_out(np.array(START), first.wheel_speeds[None], np.array([0.1]))[-1]
    law.step(Observation(PERIOD, pose))
    law.after_step(0.25)
    pose = given.robot.roll_out(pose, first.wheel_speeds[None], np.array([0.26]))[-1]
    ahead = given.robot.roll_out(pose, first.wheel_speeds[None], np.array([0.1]))[-1]
    decision = law.step(Observation(PERIOD + 260 * MS, pose))
    np.testing.assert_allclose(decision.plan.poses[0], ahead, atol=1e-12)


def test_repeated_lateness_halves_the_work_and_steps_in_time_take_it_back():
    lateness = Lateness()
    halvings = []
    for _ in range(6):
        lateness.add(0.3)
        assert lateness.begin_step() == 0.3
        halvings.append(lateness.halvings)
    assert halvings == [0, 1, 2, 3, 3, 3]
    for _ in range(100):
        assert lateness.begin_step() == 0.0
    assert (lateness.halvings, lateness.expected) == (0, 0.0)


def test_half_the_work_is_done_where_it_is_bounded():
    tight = replace(CASE_3, solver=replace(CASE_3.solver, work_share=2e-4))
    iterations = []
    for late in (0.0, 0.3):
        law = GuidanceLaw(tight, tight.world)
        for step in range(6):
            decision = law.step(Observation(step * PERIOD, np.array(START)))
            law.after_step(late)
        iterations.append(decision.iterations)
    assert iterations[1] < iterations[0]


@pytest.mark.parametrize('delay', [0.0, 0.6])
def test_where_a_late_command_would_not_find_the_path_clear_the_robot_is_slower(delay):
    """Any command may go on for six tenths of a second more than planned."""
    given = replace(CASE_3, initial_guess=ROAD, max_command_delay=delay)
    law, pose, nearest, slowed = GuidanceLaw(given, given.world), np.array(START), np.inf, 0
    for stamp in range(0, 10_000 * MS, PERIOD):
        decision = law.step(Observation(stamp, pose))
        slowed += 'Slowed to' in decision.reason
        held = np.tile(decision.wheel_speeds, (80, 1))
        path = given.robot.roll_out(pose, held, np.full(80, 0.01))
        nearest, pose = min(nearest, clearance(path, given)), path[20]
    assert (nearest >= -1e-9, slowed > 0) == (delay > 0.0,) * 2
