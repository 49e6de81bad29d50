"""A limit of the wheels' jerk: smooth commands on differential drives and cars, and hard stops."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from models import assert_arrives, drive
from scenarios import PERIOD, START, clearance, law_of, reconfigure, start_of
from scenarios import drive as drive_law

from cmpsp_ros.guidance import FallbackLevel, Safety, remaining
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import Planner, PlanningContext
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING, Validator
from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, load_parameter_file
from cmpsp_ros.robots.motion import smoothed
from cmpsp_ros.world.obstacles import Obstacle

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('jerk')

ACCELERATION = 'robot.max_wheel_acceleration=50.0'
FLOOR = (
    'road.type=none',
    'goal.position=[5.0, -2.5]',
    'initial_pose=[0.0, 0.0, 0.5]',
    'goal.when=soonest',
    'robot.max_wheel_speed=40.0',
    'solver.initial_iterations=36',
    ACCELERATION,
)


def second_differences(decisions):
    """Second differences of the wheel speeds of each command before the first stop ``(D, W)``."""
    stops = [each.level is FallbackLevel.STOP for each in decisions]
    speeds = np.array([each.wheel_speeds for each in decisions[: stops.index(True)]])
    return np.abs(np.diff(np.vstack([0.0 * speeds[:1], 0.0 * speeds[:1], speeds]), n=2, axis=0))


@pytest.mark.parametrize(
    ('preset', 'given', 'jerk'),
    [
        ('case3', (ACCELERATION, 'final_time=12.0'), 100.0),
        ('case3', (ACCELERATION, 'final_time=12.0'), 40.0),
        ('lane_change', (), 8.0),
    ],
)
def test_commands_are_smooth_and_the_robot_arrives(preset, given, jerk):
    _, free, _, _ = drive(preset, *given)
    run = drive(preset, *given, f'robot.max_wheel_jerk={jerk}')
    limit = jerk * run[0].control_period ** 2
    assert_arrives(*run)
    assert second_differences(free).max() > 2.0 * limit
    assert 0.9 * limit < second_differences(run[1]).max() <= limit + CHANGE_ROUNDING


def test_as_soon_as_possible_ends_smoothly_and_little_later():
    times = []
    for jerk in (0.0, 100.0):
        settings, decisions, *_ = drive('case1', *FLOOR, f'robot.max_wheel_jerk={jerk}')
        assert not decisions[-1].missed
        times.append(next(each.stamp for each in decisions if each.finished) / 1e9)
    assert second_differences(decisions).max() <= settings.max_second_difference + CHANGE_ROUNDING
    # To rest, too, and from there on.
    last = [each.wheel_speeds for each in decisions if not each.finished][-2:]
    ending = np.diff(np.vstack([last, np.zeros((2, 2))]), n=2, axis=0)
    assert np.abs(ending).max() <= settings.max_second_difference + CHANGE_ROUNDING
    assert times[0] < times[1] < times[0] + 1.5


def limited(jerk=50.0):
    """Case 3 with limits of acceleration and jerk: 6 and 2 rad/s between commands."""
    values = {
        **load_parameter_file('case3'),
        'robot.max_wheel_acceleration': 30.0,
        'robot.max_wheel_jerk': jerk,
        'initial_guess.type': 'road',
        'final_time': 14.0,
    }
    return guidance_settings(TABLE.resolve(values))


def test_all_of_a_plan_keeps_it():
    settings = limited()
    horizon = remaining(0, PERIOD, 14 * 10**9)
    context = PlanningContext.at_pose(settings, settings.world, np.array(START), horizon)
    planner = Planner(OcpFormulation(settings, settings.world))
    result = planner.improve(context, context.center_line_guess, iterations=6)
    assert result.solved
    commands = np.vstack([np.zeros((2, 2)), result.plan.controls[:-1]])
    found = np.abs(np.diff(commands, n=2, axis=0)).max()
    assert found == pytest.approx(settings.max_second_difference, abs=CHANGE_ROUNDING)


def test_a_command_that_jerks_is_refused_and_a_smooth_one_is_not():
    settings = limited()
    previous, change = np.full(2, 20.0), np.full(2, 3.0)
    start = start_of(settings, START, previous_control=previous, previous_change=change)
    for step, passes in ((5.0, True), (1.0, True), (5.1, False), (0.9, False), (-2.0, False)):
        plan = np.vstack([previous + step, np.tile(previous + step, (20, 1))])
        verdict = Validator(settings).check(start, plan, np.full(20, 0.2))
        assert verdict.passed == passes, step
        assert ('acceleration of a wheel by' in verdict.reason) != passes


def test_a_stop_brakes_as_hard_as_the_wheels_can_and_the_start_after_it_is_smooth():
    given = replace(limited(), safety=Safety(stopping_time=0.0))

    def block(run, _stamp):
        if len(run.decisions) == 20:
            ahead = np.arctan2(run.pose[1], run.pose[0]) + 0.26
            center = 10.0 * np.cos(ahead), 10.0 * np.sin(ahead)
            reconfigure(law, replace(given, obstacles=(Obstacle('new', center, 0.95),)))

    law = law_of(given)
    run = drive_law(law, given, [k * PERIOD for k in range(60)], before=block)
    stops = np.array([each.level is FallbackLevel.STOP for each in run.decisions])
    changes = np.diff(run.controls, axis=0, prepend=np.zeros((1, 2)))
    before = np.vstack([np.zeros((1, 2)), changes[:-1]])
    # It takes what the acceleration allows at once, three times as much as the jerk does.
    first = int(stops.argmax())
    assert np.abs(changes[first] - before[first]).max() > 2.0 * given.max_second_difference
    assert np.abs(changes).max() <= given.max_wheel_change + CHANGE_ROUNDING
    assert clearance(run.path, law.task) > 0.0
    before[1:][stops[:-1]] = 0.0
    again = np.abs(changes - before)[~stops]
    assert any(each and not after for each, after in pairwise(stops))
    assert again.max() <= given.max_second_difference + CHANGE_ROUNDING


def test_smoothing_leaves_a_smooth_plan_alone_and_reaches_any_other():
    limits = 40.0, 8.0, 2.0
    rest = np.zeros(2)
    steps = np.concatenate([[2.0, 4.0, 6.0, 8.0, 8.0, 6.0, 4.0, 2.0], np.zeros(4)])
    smooth = np.cumsum(np.column_stack([steps, -0.5 * steps]), axis=0)
    np.testing.assert_array_equal(smoothed(smooth, rest, rest, limits, 2), smooth)
    sudden = np.vstack([np.tile([40.0, 10.0], (30, 1)), np.tile([-5.0, 10.0], (30, 1))])
    found = smoothed(sudden, rest, rest, limits, 2)
    np.testing.assert_allclose(found[[29, -1]], sudden[[29, -1]], atol=1e-9)
    changes = np.diff(found, axis=0, prepend=0.0 * found[:1])
    assert np.abs(changes).max() <= 8.0 + 1e-9
    assert np.abs(np.diff(changes, axis=0, prepend=0.0 * changes[:1])).max() <= 2.0 + 1e-9
    assert np.abs(found).max() <= 40.0
    steered = smoothed(sudden, rest, rest, limits, 1)
    np.testing.assert_array_equal(steered[:, 1], sudden[:, 1])


@pytest.mark.parametrize(
    ('given', 'key'),
    [
        ({'robot.max_wheel_jerk': 9.0}, 'robot.max_wheel_acceleration'),
        (
            {
                **load_parameter_file('omni_aisle'),
                'robot.max_wheel_acceleration': 50.0,
                'robot.max_wheel_jerk': 9.0,
            },
            'robot.max_wheel_jerk',
        ),
    ],
)
def test_it_needs_a_limit_of_acceleration_and_a_robot_that_has_it(given, key):
    with pytest.raises(ParameterError, match=key):
        guidance_settings(TABLE.resolve(given))
