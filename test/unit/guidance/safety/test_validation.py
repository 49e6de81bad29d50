"""The audit refuses each thing it is there to refuse, and nothing else."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import FIRST, PERIOD, SECOND, clearance, settings, start_of

from cmpsp_ros.guidance import GuidanceLaw, Horizon, Observation, Plan, Safety
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.prediction.response import Response
from cmpsp_ros.guidance.safety import Validator, plan_clearance
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world.obstacles import MovingDiscs, Obstacle

HERE = np.array([0.0, -10.0, 0.0])
GIVEN = settings((FIRST, SECOND), 51.0)
TIMES = np.full(5, 0.2)


def controls(right, left, steps=5):
    return np.tile([float(right), float(left)], (steps + 1, 1))


def test_a_clear_plan_passes():
    verdict = Validator(GIVEN).check(start_of(GIVEN, HERE), controls(45, 44.5), TIMES)
    assert verdict.passed
    assert verdict.reason == ''
    path = GIVEN.robot.roll_out(HERE, controls(45, 44.5, 1000), np.full(1000, 1e-3))
    assert verdict.margin == pytest.approx(clearance(path[:201], GIVEN), abs=1e-6)
    assert verdict.worst_margin == pytest.approx(clearance(path, GIVEN), abs=1e-6)
    assert verdict.worst_margin <= verdict.margin


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize('place', [(0, 0), (3, 1), (5, 0)])
def test_not_finite(bad, place):
    plan = controls(45, 45)
    plan[place] = bad
    for given in (GIVEN, replace(GIVEN, robot=settings().robot)):
        verdict = Validator(given).check(start_of(given, HERE), plan, TIMES)
        assert not verdict.passed
        assert 'not a finite number' in verdict.reason


@pytest.mark.parametrize('pose', [[math.nan, -10.0, 0.0], [0.0, -10.0, math.inf]])
def test_a_pose_that_is_not_finite(pose):
    with np.errstate(invalid='ignore'):
        verdict = Validator(GIVEN).check(start_of(GIVEN, np.array(pose)), controls(45, 45), TIMES)
    assert not verdict.passed


def accelerating(limit, obstacles=(FIRST, SECOND)):
    given = settings(obstacles, 51.0)
    return replace(given, robot=replace(given.robot, max_wheel_acceleration=limit))


@pytest.mark.parametrize('place', [(0, 0), (0, 1), (3, 1), (4, 0)])
def test_a_plan_that_the_wheels_cannot_follow(place):
    given, plan = accelerating(10.0), controls(30, 30)
    start = start_of(given, HERE, previous_control=np.array([29.0, 31.0]))
    assert Validator(given).check(start, plan, TIMES).passed
    plan[place] = 27.0 if place[1] == 0 else 34.0
    verdict = Validator(given).check(start, plan, TIMES)
    assert not verdict.passed
    assert 'rad/s from one command to the next, the limit is 2.0 rad/s' in verdict.reason
    # The last control moves nothing.
    plan = controls(30, 30)
    plan[5] = 0.0
    assert Validator(given).check(start, plan, TIMES).passed


@pytest.mark.parametrize(('limit', 'passed'), [(15.0, False), (60.0, True), (math.inf, True)])
def test_a_plan_after_whose_first_command_the_robot_cannot_stop(limit, passed):
    """It is clear for the next 0.2 s, and leads into an obstacle 1 m ahead."""
    given = accelerating(limit, (Obstacle('rock', (2.0, -10.0), 1.0),))
    held = np.array([30.0, 30.0])
    start, plan = start_of(given, HERE, previous_control=held), controls(30, 30)
    verdict = Validator(given).check(start, plan, TIMES)
    assert verdict.margin == pytest.approx(1.0 - 0.21, abs=2e-3)
    assert verdict.passed == passed
    if passed:
        ramp = verdict.ramp
        assert len(ramp) == (3 if limit < math.inf else 0)
    else:
        assert verdict.reason.startswith('To stop after the next 0.2 s leads ')
        assert verdict.reason.endswith(' into obstacle rock.')


def test_a_robot_brakes_along_its_plan_where_its_curvature_leads_into_something():
    """The plan turns away from a rock that the first command points at."""
    given = accelerating(60.0, (Obstacle('rock', (1.2, -10.0), 0.3),))
    plan = np.array([[36, 36], [40, 26], [40, 26], [40, 26], [36, 36], [0, 0]], dtype=float)
    start = start_of(given, HERE, previous_control=plan[0])
    verdict = Validator(given).check(start, plan, TIMES)
    assert verdict.passed
    assert np.ptp(verdict.ramp[0]) > 1.0


def test_wheel_limits():
    for place in ((0, 0), (4, 1), (5, 1)):
        plan = controls(51, -51)
        assert 'limit' not in Validator(GIVEN).check(start_of(GIVEN, HERE), plan, TIMES).reason
        plan[place] = -np.nextafter(51.0, 52.0)
        verdict = Validator(GIVEN).check(start_of(GIVEN, HERE), plan, TIMES)
        assert not verdict.passed
        assert '51.00000000000001 rad/s, the limit is 51.0 rad/s' in verdict.reason


@pytest.mark.parametrize(
    ('pose', 'named'),
    [
        ((0.0, -10.9, -math.pi / 2), 'the outer road edge'),
        ((0.0, -9.1, math.pi / 2), 'the inner road edge'),
        ((7.2, -6.0, 0.0), 'obstacle first'),
        ((10.0, -2.6, math.pi / 2), 'obstacle second'),
    ],
)
def test_what_the_next_period_would_hit_is_named(pose, named):
    verdict = Validator(GIVEN).check(start_of(GIVEN, np.array(pose)), controls(45, 45), TIMES)
    assert not verdict.passed
    assert named in verdict.reason
    assert 'next 0.2 s' in verdict.reason
    assert verdict.margin < 0.0


def test_what_comes_later_is_reported_but_not_refused():
    pose = np.array([7.3 - 0.4, -6.0, 0.0])
    assert 45.0 * 0.035 * 0.2 < 0.4
    verdict = Validator(GIVEN).check(start_of(GIVEN, pose), controls(45, 45), TIMES)
    assert verdict.passed
    assert verdict.margin > 0.0
    assert verdict.worst_margin < -0.5
    assert verdict.nearest == 'obstacle first'


def test_path_is_swept_between_samples():
    # Both ends of the first period are clear of a pole in the middle of it.
    pole = Obstacle('pole', (0.1575, -10.0), 0.1)
    given = replace(GIVEN, obstacles=(pole,))
    plan = controls(45, 45)
    swept = Validator(given).check(start_of(given, HERE), plan, TIMES)
    assert not swept.passed
    assert swept.margin == pytest.approx(-0.1, abs=1e-9)
    sampled = Validator(replace(given, safety=Safety(between_samples=False))).check(
        start_of(given, HERE), plan, TIMES
    )
    assert sampled.passed


def test_duration_of_the_first_period_counts():
    given = replace(GIVEN, obstacles=(Obstacle('ahead', (0.6, -10.0), 0.2),))
    assert (
        Validator(given)
        .check(start_of(given, HERE), controls(45, 45, 2), np.array([0.2, 0.2]))
        .passed
    )
    assert (
        not Validator(given)
        .check(start_of(given, HERE), controls(45, 45, 2), np.array([0.29, 0.2]))
        .passed
    )


def test_radius_of_the_robot_counts_and_the_margin_does_not():
    pose = np.array([0.0, -10.85, 0.0])
    wide = replace(GIVEN, robot_radius=0.2)
    assert Validator(GIVEN).check(start_of(GIVEN, pose), controls(1, 1), TIMES).passed
    assert Validator(GIVEN).clearance_at(GIVEN.world, pose)[0] == pytest.approx(0.15)
    assert Validator(wide).clearance_at(wide.world, pose)[0] == pytest.approx(-0.05)
    careful = replace(GIVEN, safety=Safety(margin=0.2))
    assert Validator(careful).check(start_of(GIVEN, pose), controls(1, 1), TIMES).passed


@pytest.mark.parametrize('between', [True, False])
def test_outside_the_road_it_may_come_back_but_not_get_further_out(between):
    given = replace(GIVEN, safety=Safety(between_samples=between))
    validator = Validator(given)
    out = np.array([0.0, -11.3, math.pi / 2])
    assert validator.check(start_of(given, out), controls(20, 20), TIMES).passed
    assert not validator.check(start_of(given, out), controls(-20, -20), TIMES).passed
    assert validator.check(start_of(given, out), controls(0, 0), TIMES).passed
    assert validator.check(start_of(given, out), controls(5, -5), TIMES).passed
    assert (
        'the outer road edge'
        in validator.check(start_of(given, out), controls(-20, -20), TIMES).reason
    )


def test_inside_an_obstacle_it_may_come_out_but_not_get_deeper():
    validator = Validator(GIVEN)
    inside = np.array([7.5, -6.0, 0.0])
    assert validator.clearance_at(GIVEN.world, inside)[2] == pytest.approx(-0.2)
    assert validator.check(start_of(GIVEN, inside), controls(-20, -20), TIMES).passed
    assert not validator.check(start_of(GIVEN, inside), controls(20, 20), TIMES).passed
    # What it is not inside of may still not be touched on the way out.
    pole = Obstacle('pole', (7.35, -6.0), 0.05)
    hemmed = replace(GIVEN, obstacles=(FIRST, pole))
    assert not validator.check(start_of(hemmed, inside), controls(-20, -20), TIMES).passed


def test_at_gives_every_clearance_and_names_go_with_them():
    validator = Validator(GIVEN)
    np.testing.assert_allclose(
        validator.clearance_at(GIVEN.world, HERE),
        [1.0, 1.0, math.hypot(8, 4) - 0.7, math.hypot(10, 8) - 0.5],
    )
    assert validator.names([0, 3], GIVEN.world) == 'the outer road edge, obstacle second'
    assert validator.names([], GIVEN.world) == ''


def test_no_obstacles_and_a_single_step():
    verdict = Validator(settings()).check(
        start_of(settings(), HERE), controls(45, 45, 1), np.array([0.2])
    )
    assert verdict.passed
    assert verdict.margin == verdict.worst_margin
    assert verdict.nearest in {'the outer road edge', 'the inner road edge'}


@pytest.mark.parametrize(('lag', 'clear'), [(0.05, True), (0.6, False)])
def test_a_stop_that_wheels_which_lag_come_to_too_late(lag, clear):
    """As modelled it is clear: the robot stands 0.3 m before the rock."""
    given = accelerating(60.0, (Obstacle('rock', (1.6, -10.0), 0.3),))
    held = np.array([40.0, 40.0])
    start = start_of(given, HERE, previous_control=held)
    plan = Plan(Horizon.between([k * PERIOD for k in range(6)]), controls(40, 40), np.zeros((6, 3)))
    verdict = Validator(given).check(start, plan.controls, TIMES)
    assert verdict.passed
    response = Response(0.0, lag, held, np.empty((0, 2)), np.empty(0))
    assert Validator(given).is_clear_with(response, start, plan, verdict.ramp, 0.0) == clear


def test_a_response_without_a_lag_is_clear_beside_what_moves():
    given = accelerating(60.0, ())
    states = np.array([[4.0, -4.0, 0.5, 0.0, 0.2, 0.0, 1.0]])
    away = MovingDiscs(('disc',), states, np.zeros(1, np.int64))
    start = start_of(given, HERE)._replace(moving=away, reachable=away, touchable=away)
    plan = Plan(Horizon.between([k * PERIOD for k in range(6)]), controls(20, 20), np.zeros((6, 3)))
    ramp = Validator(given).check(start, plan.controls, TIMES).ramp
    response = Response(0.0, 0.0, np.zeros(2), np.empty((0, 2)), np.empty(0))
    assert Validator(given).is_clear_with(response, start, plan, ramp, 0.1)


def first(preset, tracks=(), **changes):
    """Settings of a preset, and the first decision."""
    values = TABLE.resolve({**load_parameter_file(preset), **changes})
    settings = guidance_settings(values)
    return settings, GuidanceLaw(settings, settings.world).step(
        Observation(0, np.array(values['initial_pose']), tracks)
    )


@pytest.mark.parametrize('preset', ['case3', 'corridor', 'goals', 'endless'])
def test_its_least_is_the_worst_clearance_of_the_decision(preset):
    settings, decision = first(preset)
    along = plan_clearance(settings, settings.world, decision)
    assert along.shape == (len(decision.plan.poses),)
    assert along.min() == pytest.approx(decision.worst_clearance, abs=1e-9)
    assert along.max() > along.min()


def test_the_robot_and_its_slip_count():
    settings, decision = first('case3_wide', **{'robot.radius': 0.1})
    assert plan_clearance(settings, settings.world, decision).min() == pytest.approx(
        decision.worst_clearance, abs=1e-9
    )
    plan, slipping = decision.plan, settings.robot.slipping(0.1)
    durations = plan.horizon.durations
    poses = slipping.roll_out(plan.poses[0], plan.controls, durations)
    found = Validator(settings).check(
        PlanStart(poses[0], slipping, settings.world), plan.controls, durations
    )
    decision = decision._replace(wheel_slip=0.1, plan=plan._replace(poses=poses))
    assert plan_clearance(settings, settings.world, decision).min() == pytest.approx(
        found.worst_margin, abs=1e-9
    )


@pytest.mark.parametrize('delay', [0.0, 0.1])
def test_what_moves_counts_where_it_will_be(delay):
    tracks = (Track(3, -100_000_000, 0.2, 5.0, -8.3, -0.4, 0.0),)
    settings, decision = first('moving', tracks, command_delay=delay)
    assert decision.tracks == tracks
    along = plan_clearance(settings, settings.world, decision)
    assert along.min() == pytest.approx(decision.worst_clearance, abs=1e-9)
    assert np.any(
        along < plan_clearance(settings, settings.world, decision._replace(tracks=())) - 0.01
    )


def test_the_last_pose_has_its_own_clearance():
    settings, decision = first('case1')
    along, (x, y, _) = plan_clearance(settings, settings.world, decision), decision.plan.poses[-1]
    assert along[-1] == pytest.approx(1.0 - abs(np.hypot(x, y) - 10.0), abs=1e-12)


def test_without_a_plan_there_is_nothing_to_tell():
    settings, decision = first('case1')
    with pytest.raises(ValueError, match='wanted one with a plan'):
        plan_clearance(settings, settings.world, decision._replace(plan=None))
