"""Control steps that take too long: the plan goes on shifted, with less work, and more slowly."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import CASES, MS, PERIOD, ROAD, START, clearance, reconfigure

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation
from cmpsp_ros.guidance.state import Lateness
from cmpsp_ros.world.obstacles import Obstacle

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
    reasons = []
    for halvings in (0, 3):
        law = GuidanceLaw(tight, tight.world)
        law._state.lateness.halvings = halvings
        reasons.append(law.step(Observation(0, np.array(START))).iterations)
    assert reasons[1] < reasons[0]


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
