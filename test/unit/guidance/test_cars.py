"""The guidance law on cars: the preset, and limits that hold at all times."""

from dataclasses import replace

import numpy as np
import pytest
from models import assert_arrives, clearance, drive
from scenarios import assert_is

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw
from cmpsp_ros.guidance.planning import Planner
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING, Validator

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('cars')

PRESET = 'lane_change'
SMALL = (
    'robot.wheel_base=0.3302',
    'robot.max_steering_angle=0.4189',
    'robot.max_steering_rate=3.2',
    'robot.max_wheel_acceleration=2.5',
    'robot.max_wheel_speed=5.0',
    'robot.radius=0.487',
    'robot.footprint=""',
)


def assert_within_limits(settings, decisions, motions):
    """Steering angle, its rate, acceleration and curvature are within their limits."""
    robot = settings.robot
    controls = np.array(
        [(0.0, 0.0), *((each.wheel_speeds[0], each.steering_angle) for each in decisions)]
    )
    changes = np.abs(np.diff(controls, axis=0))
    assert np.abs(controls[:, 1]).max() <= robot.max_steering_angle
    assert changes[:, 0].max() <= settings.max_wheel_change + CHANGE_ROUNDING
    most_steered = robot.max_steering_rate * settings.control_period
    assert changes[:, 1].max() <= most_steered * (1.0 + 1e-6)
    speed, turn_rate = np.array([each.twist for each in motions]).T
    assert (np.abs(turn_rate) * robot.half_track <= np.abs(speed) * (1.0 + 1e-9)).all()


def test_the_preset_passes_a_stopped_car():
    run = drive(PRESET)
    settings, decisions, motions, _ = run
    assert_arrives(*run)
    assert_within_limits(settings, decisions, motions)
    assert max(each.twist[0] for each in decisions) > 10.0
    assert max(each.pose[1] for each in motions) > 1.6
    assert not decisions[-1].twist.any()


def test_it_turns_back_and_forth_where_it_cannot_drive_around():
    settings, decisions, motions, pose = drive('three_point_turn')
    assert_arrives(settings, decisions, motions, pose)
    assert_within_limits(settings, decisions, motions)
    assert settings.road.width - 2.0 * settings.robot_radius < 2.0 * settings.robot.half_track
    speeds = [each.twist[0] for each in decisions]
    assert min(speeds) < -0.3
    assert max(speeds) > 0.3


@pytest.mark.parametrize('heading', [1.5707963, -1.5707963])
def test_into_a_bay_in_reverse_and_forward(heading):
    settings, decisions, motions, pose = drive('parking', f'goal.heading=[{heading}]')
    assert_arrives(settings, decisions, motions, pose)
    assert_within_limits(settings, decisions, motions)
    # It stands there, too.
    assert np.hypot(*(motions[-1].pose[:2] - settings.goal)) < 1e-3
    last = [each.twist[0] for each in decisions if each.twist.any()][-30:]
    assert np.mean(last) * heading < 0.0


def test_it_parks_in_a_gap_hardly_longer_than_the_car(monkeypatch):
    improve, works = Planner.improve, []

    def counted(self, context, *arguments):
        result = improve(self, context, *arguments)
        works.extend([result.work] if context.moves else [])
        return result

    monkeypatch.setattr(Planner, 'improve', counted)
    settings, decisions, motions, pose = drive('parallel_parking')
    # The first plan of the moves, which comes when the run has begun, has the work of one step.
    assert 0 < sum(works) <= settings.solver.work_limit(settings.control_period)
    rear, front = (np.array(each.corners)[:, 0] for each in settings.obstacles[:2])
    length = np.ptp(np.array(settings.footprint.corners)[:, 0])
    assert front.min() - rear.max() < 1.3 * length
    assert_within_limits(settings, decisions, motions)
    assert settings.target.errors(pose) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert clearance(settings, motions) > settings.safety.margin
    levels = [each.level for each in decisions]
    stood = levels.index(FallbackLevel.NOMINAL)
    assert all('moves to the goal are searched' in each.reason for each in decisions[:stood])
    on_the_way = [each for each in decisions[stood:] if not each.finished]
    assert {each.level for each in on_the_way} == {FallbackLevel.NOMINAL}
    gears = np.sign([each.twist[0] for each in on_the_way if abs(each.twist[0]) > 1e-3])
    assert np.count_nonzero(np.diff(gears)) > 10


def test_a_heading_that_there_is_no_room_for_is_said_to_be_impossible(fault):
    given = 'goal.heading=[1.5707963]', 'road.half_width=[0.6]', 'initial_pose=[0.0, 0.0, 0.0]'
    settings, decisions, motions, pose = drive('three_point_turn', *given)
    assert_within_limits(settings, decisions, motions)
    half_way = decisions[50]
    assert_is(fault, half_way)
    assert clearance(settings, motions) > 0.0
    assert np.hypot(*(pose[:2] - settings.goal)) < 0.01
    assert any(each.missed for each in decisions)


def test_a_small_car_among_obstacles_on_a_bend():
    settings, decisions, motions, pose = drive(
        'case3_wide',
        'robot.model=ackermann',
        'robot.wheel_radius=1.0',
        'robot.joint_names=[rear]',
        'initial_guess.type=road',
        'solver.work_share=0.1',
        *SMALL,
    )
    assert_within_limits(settings, decisions, motions)
    assert np.hypot(*(pose[:2] - settings.goal)) < 1e-3
    on_the_way = [each for each in decisions if not each.finished]
    assert max(each.level for each in on_the_way) <= FallbackLevel.ELASTIC


def test_a_race_car_with_the_work_that_its_plans_take():
    settings, _, motions, pose = drive('case3_wide', 'solver.work_share=0.3', robot='f1tenth')
    assert np.hypot(*(pose[:2] - settings.goal)) < 1e-3
    assert clearance(settings, motions) > 0.0


@pytest.mark.parametrize('given', [('command_delay=0.1', 'actuation_delay=0.1'), ('noise.seed=1',)])
def test_delay(given):
    settings, decisions, motions, pose = drive(PRESET, *given)
    assert_arrives(settings, decisions, motions, pose)
    assert_within_limits(settings, decisions, motions)


def test_a_stop_holds_the_steering_and_brakes_along_the_arc():
    settings, decisions, _, _ = drive(PRESET, 'final_time=10.0')
    law = GuidanceLaw(settings, settings.world)
    stops = [each for each in decisions if each.level == FallbackLevel.STOP]
    assert len({each.steering_angle for each in stops}) == 1
    speeds = [float(each.wheel_speeds[0]) for each in stops]
    assert speeds == sorted(speeds, reverse=True)
    assert law.halt(0, 'A stop.').steering_angle == 0.0


def test_a_plan_that_steers_too_far_is_refused():
    settings, decisions, _, _ = drive(PRESET)
    plan = max((each.plan for each in decisions if each.plan), key=lambda p: abs(p.controls).max())
    robot = replace(settings.robot, max_steering_angle=1e-6)
    start = PlanStart(plan.poses[0], robot, settings.world, previous_control=plan.controls[0])
    validator = Validator(replace(settings, robot=robot))
    verdict = validator.check(start, plan.controls, plan.horizon.durations)
    assert not verdict.passed
    assert 'rad, the limit is 1e-06 rad' in verdict.reason
