"""The guidance law on robots that drive sideways: the preset, its limits and disturbances."""

from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.demo.scenario import load_scenario
from cmpsp_ros.guidance.decision import FallbackLevel
from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.safety.audit import CHANGE_ROUNDING, Audit
from cmpsp_ros.parameters.settings import plant_settings
from cmpsp_ros.simulator.plant import Plant
from cmpsp_ros.world.free_space import FreeSpace

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('omnidirectional')

ACCELERATION = 'robot.max_wheel_acceleration=20.26'


def drive(*given):
    """Settings, decisions, motions and the pose at the final time of a run of the preset."""
    scenario = load_scenario('omni_aisle', given, lockstep=True)
    settings = scenario.settings
    law, plant = GuidanceLaw(settings), Plant(plant_settings(scenario.values))
    pose, decisions, motions = plant.pose, [], [plant.motion]
    final = round(settings.final_time * 1e9)
    for stamp in range(0, final + 2 * 10**9, 20_000_000):
        motions += [*plant.advance(stamp), plant.motion]
        pose = plant.pose if stamp <= final else pose
        decision = law.update(stamp, plant.measure())
        if decision is not None:
            decisions.append(decision)
            plant.command(stamp, *decision.twist.tolist())
    return settings, decisions, motions, pose


def clearance(settings, motions):
    space = FreeSpace.of(settings.road, settings.obstacles, settings.robot_radius)
    poses, twists = (np.array([getattr(m, name) for m in motions]) for name in ('pose', 'twist'))
    durations = np.diff([each.stamp_ns for each in motions]) / 1e9
    return space.along(poses[:-1], twists[:-1], durations).min()


def assert_arrives(settings, decisions, motions, pose):
    on_the_way = [each for each in decisions if not each.finished]
    assert {each.level for each in on_the_way} == {FallbackLevel.NOMINAL}
    assert np.hypot(*(pose[:2] - settings.goal)) < 1e-3
    if settings.goal_heading is not None:
        assert abs(pose[2] - settings.goal_heading) < 1e-2
    assert clearance(settings, motions) > 0.0
    fastest = max(np.abs(each.wheel_speeds).max() for each in decisions)
    assert fastest <= settings.robot.max_wheel_speed
    assert np.abs([each.wheel_speeds for each in motions]).max() <= fastest * (1.0 + 1e-12)


def test_the_preset_is_driven_sideways_and_bit_for_bit_again():
    run = drive()
    assert_arrives(*run)
    _, decisions, motions, _ = run
    assert min(np.array([each.twist for each in decisions])[:, 1]) < -0.3
    _, again, motions_again, _ = drive()
    for one, other in zip(decisions, again, strict=True):
        assert one.twist.tobytes() == other.twist.tobytes()
        assert one.reason == other.reason
    assert motions[-1].pose.tobytes() == motions_again[-1].pose.tobytes()


def test_three_omni_wheels():
    assert_arrives(
        *drive(
            'robot.model=omni_wheels',
            'robot.wheel_bearings=[1.0471976, 3.1415927, 5.2359878]',
            'robot.joint_names=[a, b, c]',
        )
    )


def test_limited_acceleration_holds_for_each_wheel_in_the_stop_too():
    settings, decisions, motions, pose = drive(ACCELERATION)
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
    assert_arrives(*drive(*given))


def test_a_goal_beside_the_robot_needs_no_turn():
    settings, decisions, motions, pose = drive(
        'goal.position=[0.0, 0.25]', 'goal.heading=[0.0]', 'final_time=3.0'
    )
    assert_arrives(settings, decisions, motions, pose)
    assert max(abs(each.pose[2]) for each in motions) < 1e-3


def test_a_plan_that_a_wheel_cannot_follow_is_refused():
    settings, decisions, _, _ = drive()
    plan = decisions[0].plan
    robot = replace(settings.robot, max_wheel_speed=1.0)
    start = PlanStart(plan.poses[0], robot, previous_control=robot.at_rest)
    audit = Audit(replace(settings, robot=robot))
    verdict = audit.check(start, plan.controls, plan.horizon.durations)
    assert not verdict.passed
    assert 'rad/s, the limit is 1.0 rad/s' in verdict.reason
