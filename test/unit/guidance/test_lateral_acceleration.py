"""A limit of speed times turn rate: bends are driven more slowly, on every kind of robot."""

import math
from dataclasses import replace

import numpy as np
import pytest
from models import assert_arrives, drive
from scenarios import START, start_of

from cmpsp_ros.guidance import FallbackLevel
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING, Validator
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.robots.motion import speeds_and_turns

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('cars')

LIMIT = 1.0
CAR = (
    'robot.model=ackermann',
    'robot.wheel_radius=1.0',
    'robot.wheel_base=0.3302',
    'robot.max_steering_angle=0.4189',
    'robot.max_steering_rate=3.2',
    'robot.max_wheel_acceleration=2.5',
    'robot.max_wheel_speed=4.0',
    'robot.joint_names=[rear_axle]',
    'initial_guess.type=road',
)
BEND = (
    'road.type=corridor',
    'road.points=[-1.0, 0.0, 5.0, 0.0, 7.4, 0.6, 8.0, 3.0, 8.0, 12.0]',
    'road.half_width=[0.4]',
    'goal.position=[8.0, 9.0]',
    'initial_pose=[0.0, 0.0, 0.0]',
    'final_time=10.0',
    'weights.control_rate=2.0',
)
"""A bend between two straights of 5 m."""


def across(decisions):
    """Lateral acceleration of each command [m/s^2]."""
    speeds, turn_rates = speeds_and_turns(np.array([each.twist for each in decisions])).T
    return np.abs(speeds * turn_rates)


def test_a_car_slows_down_in_a_bend_and_is_as_fast_as_needed_before_and_after():
    free = drive('case1', *CAR, *BEND)
    run = drive('case1', *CAR, *BEND, f'robot.max_lateral_acceleration={LIMIT}')
    assert_arrives(*free)
    assert_arrives(*run)
    assert across(free[1]).max() > 1.5 * LIMIT
    assert 0.9 * LIMIT < across(run[1]).max() <= LIMIT
    twists = np.array([each.twist for each in run[1] if not each.finished])
    bend = np.abs(twists[:, 1]) > 0.6
    assert bend.any()
    assert twists[bend, 0].min() < 1.4
    assert twists[~bend, 0].max() > 1.95
    changes = np.abs(np.diff([each.wheel_speeds[0] for each in run[1]], prepend=0.0))
    assert changes.max() <= run[0].max_wheel_change + CHANGE_ROUNDING


@pytest.mark.parametrize(
    ('preset', 'limit', 'given'),
    [
        ('case3', 1.0, ()),
        ('case3', 1.0, ('robot.max_wheel_acceleration=50.0', 'final_time=12.0')),
        ('case3', 1.0, ('wheel_slip=[0.05, 0.05]', 'max_wheel_slip=0.1', 'final_time=12.0')),
        ('lane_change', 1.0, ()),
        ('omni_aisle', 0.05, ('goal.heading=[1.5]',)),
    ],
)
def test_every_robot_keeps_it_in_every_command(preset, limit, given):
    _, free, _, _ = drive(preset, *given)
    run = drive(preset, *given, f'robot.max_lateral_acceleration={limit}')
    assert across(free).max() > 1.5 * limit
    assert 0.5 * limit < across(run[1]).max() <= limit * (1.0 + 1e-9)
    assert_arrives(*run)


def test_as_soon_as_possible_is_later_with_it():
    times = []
    for limit in (0.0, 0.4):
        settings, decisions, *_ = drive(
            'case1', *CAR, *BEND, 'goal.when=soonest', f'robot.max_lateral_acceleration={limit}'
        )
        levels = {each.level for each in decisions if not each.finished}
        assert levels <= {FallbackLevel.NOMINAL, FallbackLevel.ELASTIC}
        assert not decisions[-1].missed
        assert across(decisions).max() <= settings.robot.max_lateral_acceleration
        times.append(next(each.stamp for each in decisions if each.finished) / 1e9)
    # Half of the bend's length at the speed that the limit leaves is a second more.
    assert times[0] + 0.5 < times[1] < times[0] + 5.0


def limited(**changes):
    values = {**load_parameter_file('case3'), 'robot.max_lateral_acceleration': LIMIT, **changes}
    return guidance_settings(TABLE.resolve(values))


def test_a_command_beyond_it_is_refused_and_one_at_the_limit_is_not():
    settings = limited()
    start = start_of(settings, np.array(START))
    turning = settings.robot.controls(np.array([1.0, 1.125]))
    plan, durations = np.tile(turning, (6, 1)), np.full(5, 0.2)
    verdict = Validator(settings).check(start, plan, durations)
    assert not verdict.passed
    assert 'lateral acceleration of 1.12' in verdict.reason
    rows = len(settings.world.names)
    said = Validator(settings).names([1, rows], settings.world)
    assert said == f'{settings.world.names[1]}, the lateral acceleration'
    slower = settings.robot.slowed_in_turns(plan)
    np.testing.assert_allclose(settings.robot.lateral_acceleration(slower), LIMIT, rtol=1e-12)
    assert Validator(settings).check(start, slower, durations).passed


def test_the_stop_after_every_command_keeps_it_too():
    settings = limited(**{'robot.max_wheel_acceleration': 30.0})
    start = start_of(settings, np.array(START))
    start = start._replace(previous_control=settings.robot.controls(np.array([1.2, -0.8])))
    plan = settings.robot.controls(np.array([[1.2, -0.8]] + [[1.0, -0.95]] * 10))
    verdict = Validator(settings).check(start, plan, np.full(10, 0.2))
    assert verdict.passed
    assert len(verdict.ramp) > 3
    assert settings.robot.lateral_acceleration(verdict.ramp).max() <= LIMIT


def test_slowing_down_keeps_the_arc_and_leaves_slower_commands_alone():
    robot = replace(limited().robot, max_lateral_acceleration=0.5)
    twists = np.array([[1.0, 1.0], [-1.0, 1.0], [1.0, 0.4], [0.0, 9.0]])
    slowed = robot.twist(robot.slowed_in_turns(robot.controls(twists)))
    half = math.sqrt(0.5)
    wanted = [[half, half], [-half, half], [1.0, 0.4], [0.0, 9.0]]
    np.testing.assert_allclose(slowed, wanted, atol=1e-12)
