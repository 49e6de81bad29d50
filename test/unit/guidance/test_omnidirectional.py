"""The guidance law on robots that drive sideways: the preset, its limits and disturbances."""

from dataclasses import replace

import numpy as np
import pytest
from models import assert_arrives, drive

from cmpsp_ros.demo import load_scenario
from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING, Validator

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('omnidirectional')

ACCELERATION = 'robot.max_wheel_acceleration=20.26'


PRESET = 'omni_aisle'


def test_the_preset_is_driven_sideways():
    run = drive(PRESET)
    assert_arrives(*run)
    assert min(np.array([each.twist for each in run[1]])[:, 1]) < -0.3


def test_three_omni_wheels():
    assert_arrives(
        *drive(
            PRESET,
            'robot.model=omni_wheels',
            'robot.wheel_bearings=[1.0471976, 3.1415927, 5.2359878]',
            'robot.joint_names=[a, b, c]',
        )
    )


def test_limited_acceleration_holds_for_each_wheel_in_the_stop_too():
    settings, decisions, motions, pose = drive(PRESET, ACCELERATION)
    assert_arrives(settings, decisions, motions, pose)
    wheels = np.array([np.zeros(4), *(each.wheel_speeds for each in decisions)])
    changes = np.abs(np.diff(wheels, axis=0))
    assert changes.max() <= settings.max_wheel_change + CHANGE_ROUNDING
    assert changes.max() > 0.9 * settings.max_wheel_change
    assert not decisions[-1].twist.any()


@pytest.mark.parametrize(
    'given',
    [
        ('command_delay=0.1', 'actuation_delay=0.1'),
        ('wheel_slip=[0.05, 0.05]', 'max_wheel_slip=0.1'),
        ('weights.control_rate=0.5', ACCELERATION),
    ],
)
def test_disturbances_and_a_cost_of_changes(given):
    assert_arrives(*drive(PRESET, *given))


def test_a_goal_beside_the_robot_needs_no_turn():
    settings, decisions, motions, pose = drive(
        PRESET, 'goal.position=[0.0, 0.25]', 'goal.heading=[0.0]', 'final_time=3.0'
    )
    assert_arrives(settings, decisions, motions, pose)
    assert max(abs(each.pose[2]) for each in motions) < 1e-3


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


def test_a_plan_that_a_wheel_cannot_follow_is_refused():
    settings, decisions, _, _ = drive(PRESET)
    plan = decisions[0].plan
    robot = replace(settings.robot, max_wheel_speed=1.0)
    start = PlanStart(plan.poses[0], robot, settings.world, previous_control=robot.at_rest)
    validator = Validator(replace(settings, robot=robot))
    verdict = validator.check(start, plan.controls, plan.horizon.durations)
    assert not verdict.passed
    assert 'rad/s, the limit is 1.0 rad/s' in verdict.reason
