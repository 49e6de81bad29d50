"""Fallback levels of the law when no new plan will do, and stops."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scenarios import (
    CASES,
    ON_TIME,
    PERIOD,
    SETTLED,
    START,
    after,
    broken,
    clearance,
    drive,
    reconfigure,
    settings,
)
from tight_places import task

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation, Plan, remaining
from cmpsp_ros.guidance.commands.fallback import Fallback
from cmpsp_ros.guidance.planning import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.world.obstacles import Obstacle


def test_failure_at_the_very_first_step_stops(monkeypatch):
    law = GuidanceLaw(CASES['case 1'], CASES['case 1'].world)
    broken(monkeypatch)
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
