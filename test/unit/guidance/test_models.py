"""The guidance law on cars, on robots that drive sideways and on those with corners."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from models import assert_arrives, assert_the_same, assert_within_limits, clearance, drive
from scenarios import assert_is

from cmpsp_ros.demo import load_scenario
from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING, Validator

DELAY = 'command_delay=0.1', 'actuation_delay=0.1'
ACCELERATION = 'robot.max_wheel_acceleration=20.26'
IN_REVERSE, FORWARD = 'goal.heading=[1.5707963]', 'goal.heading=[-1.5707963]'
THREE_WHEELS = (
    'robot.model=omni_wheels', 'robot.wheel_bearings=[1.0471976, 3.1415927, 5.2359878]',
    'robot.joint_names=[a, b, c]',
)  # fmt: skip
SMALL_CAR = (
    'robot.model=ackermann', 'robot.wheel_radius=1.0', 'robot.joint_names=[rear]',
    'initial_guess.type=road', 'solver.work_share=0.1', 'robot.wheel_base=0.3302',
    'robot.max_steering_angle=0.4189', 'robot.max_steering_rate=3.2',
    'robot.max_wheel_acceleration=2.5', 'robot.max_wheel_speed=5.0', 'robot.radius=0.487',
    'robot.footprint=""',
)  # fmt: skip

driven = cache(drive)


def rows(*given):
    """Presets and what differs from them; what one of them compiles is compiled by one worker."""
    return pytest.mark.parametrize(
        ('preset', 'changes'),
        [
            pytest.param(preset, changes, marks=pytest.mark.xdist_group(preset))
            for preset, *changes in given
        ],
    )


@rows(('lane_change',), ('omni_aisle',), ('slot',), ('parking', IN_REVERSE), ('parking', FORWARD))
def test_presets_are_driven_and_bit_for_bit_again(preset, changes):
    run = driven(preset, *changes)
    assert_arrives(*run)
    assert_the_same(run, drive(preset, *changes))


@rows(
    ('three_point_turn',),
    ('lane_change', *DELAY),
    ('lane_change', 'noise.seed=1'),
    ('omni_aisle', *THREE_WHEELS),
    ('omni_aisle', *DELAY),
    ('omni_aisle', 'wheel_slip=[0.05, 0.05]', 'max_wheel_slip=0.1'),
    ('slot', *DELAY),
    ('slot', 'robot.max_wheel_acceleration=15.0'),
    ('slot', 'safety.between_samples=false'),
    ('slot', 'robot.max_wheel_speed=0.0'),
)
def test_other_settings_and_disturbances(preset, changes):
    assert_arrives(*driven(preset, *changes))


@pytest.mark.xdist_group('lane_change')
def test_a_car_passes_a_stopped_one_and_brakes_along_the_arc():
    settings, decisions, motions, _ = driven('lane_change')
    assert max(each.twist[0] for each in decisions) > 10.0
    assert max(each.pose[1] for each in motions) > 1.6
    assert not decisions[-1].twist.any()
    _, decisions, _, _ = drive('lane_change', 'final_time=10.0')
    stops = [each for each in decisions if each.level == FallbackLevel.STOP]
    assert len({each.steering_angle for each in stops}) == 1
    speeds = [float(each.wheel_speeds[0]) for each in stops]
    assert speeds == sorted(speeds, reverse=True)
    halt = GuidanceLaw(settings, settings.world).halt(0, 'A stop.')
    assert halt.steering_angle == 0.0


@pytest.mark.xdist_group('three_point_turn')
def test_a_car_turns_back_and_forth_where_it_cannot_drive_around():
    settings, decisions, _, _ = driven('three_point_turn')
    assert settings.road.width - 2.0 * settings.robot_radius < 2.0 * settings.robot.half_track
    speeds = [each.twist[0] for each in decisions]
    assert min(speeds) < -0.3
    assert max(speeds) > 0.3


@pytest.mark.xdist_group('parking')
@pytest.mark.parametrize(('heading', 'direction'), [(IN_REVERSE, -1.0), (FORWARD, 1.0)])
def test_a_car_stands_in_its_bay(heading, direction):
    settings, decisions, motions, _ = driven('parking', heading)
    assert np.hypot(*(motions[-1].pose[:2] - settings.goal)) < 1e-3
    last = [each.twist[0] for each in decisions if each.twist.any()][-30:]
    assert np.mean(last) * direction > 0.0


@pytest.mark.xdist_group('three_point_turn')
def test_a_heading_that_there_is_no_room_for_is_said_to_be_impossible(fault):
    given = IN_REVERSE, 'road.half_width=[0.6]', 'initial_pose=[0.0, 0.0, 0.0]'
    settings, decisions, motions, pose = drive('three_point_turn', *given)
    assert_within_limits(settings, decisions, motions)
    assert_is(fault, decisions[50])
    assert clearance(settings, motions) > 0.0
    assert np.hypot(*(pose[:2] - settings.goal)) < 0.01
    assert any(each.missed for each in decisions)


@pytest.mark.xdist_group('lane_change')
@pytest.mark.parametrize(
    ('changes', 'robot'), [(SMALL_CAR, None), (['solver.work_share=0.3'], 'f1tenth')]
)
def test_small_cars_among_obstacles_on_a_bend(changes, robot):
    settings, decisions, motions, pose = drive('case3_wide', *changes, robot=robot)
    assert_within_limits(settings, decisions, motions)
    assert np.hypot(*(pose[:2] - settings.goal)) < 1e-3
    assert clearance(settings, motions) > 0.0
    on_the_way = [each for each in decisions if not each.finished]
    assert max(each.level for each in on_the_way) <= FallbackLevel.ELASTIC


@pytest.mark.parametrize(
    ('preset', 'change', 'said'),
    [
        pytest.param(
            *('lane_change', {'max_steering_angle': 1e-6}, 'rad, the limit is 1e-06 rad'),
            marks=pytest.mark.xdist_group('lane_change'),
        ),
        pytest.param(
            *('omni_aisle', {'max_wheel_speed': 1.0}, 'rad/s, the limit is 1.0 rad/s'),
            marks=pytest.mark.xdist_group('omni_aisle'),
        ),
    ],
)
def test_a_plan_that_a_robot_cannot_follow_is_refused(preset, change, said):
    settings, decisions, _, _ = driven(preset)
    plan = max((each.plan for each in decisions if each.plan), key=lambda p: abs(p.controls).max())
    robot = replace(settings.robot, **change)
    start = PlanStart(plan.poses[0], robot, settings.world, previous_control=plan.controls[0])
    validator = Validator(replace(settings, robot=robot))
    verdict = validator.check(start, plan.controls, plan.horizon.durations)
    assert not verdict.passed
    assert said in verdict.reason


@pytest.mark.xdist_group('omni_aisle')
def test_a_robot_that_can_drives_sideways_and_needs_no_turn():
    _, decisions, _, _ = driven('omni_aisle')
    assert min(np.array([each.twist for each in decisions])[:, 1]) < -0.3
    beside = 'goal.position=[0.0, 0.25]', 'goal.heading=[0.0]', 'final_time=3.0'
    run = drive('omni_aisle', *beside)
    assert_arrives(*run)
    assert max(abs(each.pose[2]) for each in run[2]) < 1e-3


# A solver of a size that nothing else needs is compiled for it.
@pytest.mark.slow
@pytest.mark.parametrize('rate', [0.0, 0.5])
def test_limited_acceleration_holds_for_each_wheel_in_the_stop_too(rate):
    settings, decisions, motions, pose = drive(
        'omni_aisle', ACCELERATION, f'weights.control_rate={rate}'
    )
    assert_arrives(settings, decisions, motions, pose)
    wheels = np.array([np.zeros(4), *(each.wheel_speeds for each in decisions)])
    changes = np.abs(np.diff(wheels, axis=0))
    assert changes.max() <= settings.max_wheel_change + CHANGE_ROUNDING
    # A price on changes makes them smaller.
    assert rate or changes.max() > 0.9 * settings.max_wheel_change
    assert not decisions[-1].twist.any()


@pytest.mark.xdist_group('omni_aisle')
def test_mecanum_wheels_at_their_limit_for_a_hundred_steps():
    scenario = load_scenario('case3_wide', (), lockstep=True, robot='mecanum')
    law, robot = GuidanceLaw(scenario.settings, scenario.settings.world), scenario.settings.robot
    decision = law.step(Observation(0, np.array(scenario.values['initial_pose'])))
    assert decision.level == FallbackLevel.NOMINAL
    plan = decision.plan
    fastest = np.abs(robot.speeds_of(plan.controls[:-1])).max(axis=1)
    assert (fastest > 0.999 * robot.max_wheel_speed).sum() > 40
    # Sideways it could not be there in time: it turns along the road.
    assert plan.poses[-1, 2] > 1.0


@pytest.mark.xdist_group('slot')
def test_corners_pass_a_slot_that_a_disc_around_them_does_not():
    settings, _, motions, _ = driven('slot')
    inside = [each.pose for each in motions if 1.25 < each.pose[0] < 1.6]
    assert np.abs([pose[2] for pose in inside]).max() < 0.15
    assert settings.circumscribed_radius > 0.19
    settings, decisions, _, pose = drive('slot', 'robot.footprint=""', 'robot.radius=0.252')
    assert pose[0] < 1.4
    assert not {each.level for each in decisions} <= {FallbackLevel.NOMINAL}
    assert settings.circumscribed_radius == 0.252
