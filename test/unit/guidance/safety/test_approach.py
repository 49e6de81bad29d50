"""Before what no plan passes the robot is slow enough to stop, also if it is heavier than said."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import FIRST, MS, PERIOD, ROAD, closed_loop, drive, settings, start_of

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Horizon, Observation, Plan, Safety
from cmpsp_ros.guidance.prediction.response import Response, Risk
from cmpsp_ros.guidance.safety import Validator
from cmpsp_ros.guidance.safety.approach import Approach, Conditions
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file, plant_settings
from cmpsp_ros.simulator import Plant
from cmpsp_ros.studies.monte_carlo.driving import drive as drive_study
from cmpsp_ros.studies.monte_carlo.driving import outcome
from cmpsp_ros.studies.monte_carlo.study import Study
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle

HERE = np.array([0.0, -10.0, 0.0])
ROCK = Obstacle('rock', (1.5, -10.0), 0.3)


def plan_of(given, speed, pose=HERE, steps=10):
    controls = np.full((steps + 1, 2), speed / given.robot.wheel_radius)
    horizon = Horizon.between([k * PERIOD for k in range(steps + 1)])
    return Plan(horizon, controls, given.robot.roll_out(pose, controls, horizon.durations))


def given_with(time, acceleration=math.inf, margin=0.0, obstacles=(ROCK,)):
    given = settings(obstacles, 51.0, ROAD, safety=Safety(margin, stopping_time=time))
    return replace(given, robot=replace(given.robot, max_wheel_acceleration=acceleration))


def approach(given):
    return Approach(given, Validator(given))


@pytest.mark.parametrize('speed', [0.5, 1.0, 1.7])
@pytest.mark.parametrize('margin', [0.0, 0.05])
@pytest.mark.parametrize('acceleration', [math.inf, 30.0])
def test_the_speed_leaves_room_to_stop(speed, margin, acceleration):
    given = given_with(0.4, acceleration, margin)
    plan, start = plan_of(given, speed, steps=20), start_of(given, HERE)
    found = approach(given).contact(plan, start)
    assert found.name == 'obstacle rock'
    # At least: the arc that leads into it is not looked at closely.
    assert 1.2 - 0.2 * speed <= found.distance <= 1.2 + 1e-9
    needed = found.speed * (0.2 + 0.4) + found.speed**2 / (2.0 * 0.035 * acceleration)
    assert needed == pytest.approx(found.distance - margin)


def test_the_speed_at_the_end_leaves_room_to_stop_behind_it():
    given = given_with(0.4, 30.0)
    plan, start = plan_of(given, 1.0, steps=5), start_of(given, HERE)
    found = approach(given).contact(plan, start)
    speed = approach(given).end_speed(plan, found)
    needed = speed * (0.2 + 0.4) + speed**2 / (2.0 * 0.035 * 30.0)
    assert needed == pytest.approx(found.distance - 1.0)
    # Before its end no plan is slower for it.
    assert approach(given).end_speed(plan_of(given, 1.0, steps=20), found) == math.inf


def test_a_clear_plan_meets_nothing():
    given = given_with(0.5, obstacles=(FIRST,))
    plan = plan_of(given, 0.3)
    assert approach(given).contact(plan, start_of(given, HERE)) is None


def test_what_the_robot_is_in_does_not_hold_it():
    """Off the road it is led back; it is what comes then that counts."""
    given = given_with(0.5)
    pose = np.array([0.0, -11.1, 0.0])
    found = approach(given).contact(plan_of(given, 1.0, pose), start_of(given, pose))
    assert found is None


def test_a_plan_is_slowed_down_along_its_path():
    given = given_with(0.5)
    plan, start = plan_of(given, 1.0), start_of(given, HERE)
    slowed = approach(given).slowed(plan, start, 0.25)
    np.testing.assert_allclose(slowed.controls, 0.25 * plan.controls)
    poses = given.robot.roll_out(HERE, slowed.controls, plan.horizon.durations)
    np.testing.assert_array_equal(slowed.poses, poses)
    assert approach(given).slowed(plan, start, 1.1) is None


def test_no_faster_than_the_wheels_can():
    given = given_with(0.5, 10.0)
    plan = plan_of(given, 1.0)
    start = start_of(given, HERE, previous_control=plan.controls[0])
    slowed = approach(given).slowed(plan, start, 0.1)
    np.testing.assert_allclose(plan.controls[0] - slowed.controls[0], 2.0)


def test_it_says_so_and_stops_clear():
    wall = tuple(Obstacle(f'wall {r:g}', (r, 0.0), 0.15) for r in np.arange(9.0, 11.1, 0.25))
    given = settings(wall, 51.0, ROAD, goal=(0.0, 10.0))
    run = closed_loop(given, steps=80)
    slow = [each for each in run.decisions if 'Slows down to ' in each.reason]
    assert len(slow) > 2
    assert all(each.reason.endswith(' m ahead, and no plan passes it.') for each in slow)
    for each in slow:
        said = float(each.reason.split('Slows down to ')[1].split(' m/s')[0])
        assert said == pytest.approx(abs(each.twist[0]), rel=1e-2)
    assert all(each.level is not FallbackLevel.NOMINAL for each in slow)
    # From the first such step on it is never fast again.
    speeds = [abs(each.twist[0]) for each in run.moves[slow[0].step :]]
    assert max(speeds) <= speeds[0]


def course_with_a_wall(**changes):
    """Case 3 with a wall 0.1 m thick across the road instead of its obstacles."""
    given = load_parameter_file('case3')
    given = {key: value for key, value in given.items() if not key.startswith('obstacles.')}
    ends = {'start': 8.9, 'end': 11.1}
    wall = {
        f'obstacles.wall.{end}': [radius * math.cos(-0.35), radius * math.sin(-0.35)]
        for end, radius in ends.items()
    }
    wall |= {'obstacles.names': ['wall'], 'obstacles.wall.type': 'capsule'}
    wall |= {'obstacles.wall.radius': 0.05, 'initial_guess.type': 'road'}
    return TABLE.resolve({**given, **wall, **changes})


@pytest.mark.parametrize(
    'plant',
    [{'wheel_lag': 0.1}, {'wheel_lag': 0.2, 'safety.margin': 0.05}, {'plant': 'mujoco'}],
    ids=['lag 0.1', 'lag 0.2', 'mujoco'],
)
@pytest.mark.parametrize('acceleration', [0.0, 60.0])
def test_a_robot_heavier_than_its_model_stops_before_a_wall(plant, acceleration):
    if 'plant' in plant:
        pytest.importorskip('mujoco')
    values = course_with_a_wall(**plant, **{'robot.max_wheel_acceleration': acceleration})
    given, body = guidance_settings(values), Plant(plant_settings(values))
    law, motions = GuidanceLaw(given, given.world), []
    for stamp in range(0, 11_000 * MS, 20 * MS):
        motions += [*body.advance(stamp), body.motion]
        decision = law.step(Observation(stamp, body.measure()))
        if decision is not None:
            body.command(stamp, *decision.twist.tolist())
    poses, twists = (
        np.array([getattr(each, name) for each in motions]) for name in ('pose', 'twist')
    )
    durations = np.diff([each.stamp_ns for each in motions]) / 1e9
    space = FreeSpace.of(given.road, given.obstacles, 0.0)
    clearance = space.along(poses[:-1], twists[:-1], durations)
    assert clearance.min() > 0.0
    assert np.abs(twists[:-1, 0]) @ durations > 3.0
    # It comes near it. Commands without a limit are more than tyres can hold: on these, a millionth
    # of a metre at the start, or another numpy, decides how it turns and where it ends.
    if acceleration or 'plant' not in plant:
        assert clearance[:, 2].min() < 0.6


def test_far_away_nothing_is_slowed_down():
    """A first plan that is not good yet leads into something, far ahead."""
    given = settings((FIRST,), 51.0, ROAD)
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, [k * PERIOD for k in range(50)])
    assert not any('Slows' in each.reason for each in run.decisions)


@pytest.mark.parametrize('number', [10, 46])
def test_wheels_that_lag_as_much_as_they_may_touch_nothing(number):
    """Without it, this heavy robot leaves the road."""
    assert outcome(drive_study(Study('heavy').run(number))).clearance > 0.0
    told = 'max_wheel_lag=0.0', 'command_delay_tolerance=0.0'
    heedless = Study('heavy', assignments=told)
    assert outcome(drive_study(heedless.run(number))).clearance < 0.0


@pytest.mark.parametrize(
    ('seed', 'number'), [*((1, each) for each in (86, 152, 174, 289, 396)), (2, 79), (2, 683)]
)
def test_wheels_that_lag_by_less_than_they_may_touch_nothing(seed, number):
    """With all of the lag or none alone, they touch something by up to 4 cm; 1 mm with thirds."""
    assert outcome(drive_study(Study('heavy', seed).run(number))).clearance > 0.0


def test_what_lies_between_the_paths_of_less_lag_and_more():
    """It turns off to the right: at once in front of the rock, and late behind it."""
    rock = Obstacle('rock', (0.456, -10.06), 0.03)
    given = replace(given_with(0.5, 60.0, obstacles=(rock,)), max_lag=0.3)
    wheels, plan = np.array([30.0, 20.0]), plan_of(given, 0.0)
    plan = plan._replace(controls=np.tile([18.0, 30.0], (11, 1)))
    start = start_of(given, HERE, previous_control=wheels)
    validator = Validator(given)
    verdict = validator.check(start, plan.controls, plan.horizon.durations)
    assert verdict.passed
    nothing = np.empty((0, 2)), np.empty(0)
    lags = [Response(0.0, lag, wheels, *nothing) for lag in (0.1, 0.2, 0.3)]
    clear = [validator.is_clear_with(lag, start, plan, verdict.ramp, 0.0) for lag in lags]
    assert clear == [True, False, True]
    known = Risk(lags, 0.0, 'its wheels may lag.')
    assert approach(given).calmed(plan, verdict, Conditions(start, None, start, known)) is None
    away = replace(given, obstacles=(FIRST,))
    start = start._replace(world=away.world)
    assert approach(away).calmed(plan, verdict, Conditions(start, None, start, known))[0] is plan


def test_a_plan_that_is_slowed_for_lag_says_so():
    decisions = drive_study(Study('heavy').run(14)).decisions
    assert any('its wheels may lag.' in each.reason for each in decisions)
