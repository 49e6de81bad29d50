"""Goals one after another, with headings; goals that are told; a goal that is held."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scenarios import PERIOD, SETTLED, drive

from cmpsp_ros.guidance import (
    FallbackLevel,
    Goal,
    GoalError,
    GuidanceLaw,
    Observation,
    decision_to_key_values,
    severity,
)
from cmpsp_ros.guidance.messages import goal_of
from cmpsp_ros.guidance.mission import reason_not_to_begin
from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, load_parameter_file
from cmpsp_ros.parameters.files import preset_names


def preset(name, **changes):
    values = TABLE.resolve(load_parameter_file(name))
    return replace(guidance_settings(values), **changes), values['initial_pose']


def off(one, other):
    return abs(math.remainder(one - other, math.tau))


@pytest.fixture(scope='module')
def goals_driven():
    given, start = preset('goals')
    return given, drive(
        GuidanceLaw(given, given.world), given, [k * PERIOD for k in range(301)], start
    )


def test_every_goal_is_passed_at_its_time(goals_driven):
    given, run = goals_driven
    assert [goal.name for goal in given.goals] == ['a', 'b', 'c', 'd', 'e', 'goal']
    assert {decision.level for decision in run.moves} == {FallbackLevel.NOMINAL}
    for goal in given.goals:
        pose = run.decisions[round(goal.time * 1e9) // PERIOD - 1].plan.poses[-1]
        assert math.dist(pose[:2], goal.position) < 1e-9
        assert goal.heading is None or off(pose[2], goal.heading) < 1e-9
    assert run.miss(given.goal) < 1e-9
    assert run.decisions[-1].finished
    assert not run.decisions[-1].missed


def test_decisions_say_where_they_drive(goals_driven):
    given, run = goals_driven
    for decision in run.moves:
        (goal,) = [goal for goal in given.goals if goal.time > decision.step * 0.2 + 1e-9][:1]
        said = decision_to_key_values(decision)
        assert said['goal'] == goal.name
        assert [float(said[key]) for key in ('goal_x', 'goal_y')] == list(goal.position)
        assert float(said['goal_time']) == goal.time
        # Between two goals the robot goes along the road, whatever else is asked for.
        assert ('goal_heading' in said) == (goal.name != 'goal')


def test_the_change_from_goal_to_goal_is_no_dip(goals_driven):
    given, run = goals_driven
    speeds = [decision.twist[0] for decision in run.moves]
    for begin, goal in zip((0.0, *(each.time for each in given.goals)), given.goals, strict=False):
        leg = speeds[round(begin / 0.2) : round(goal.time / 0.2)]
        assert min(leg) > 0.8 * np.mean(leg)


def test_one_goal_is_told_as_ever():
    given, start = preset('corridor')
    decision = GuidanceLaw(given, given.world).step(Observation(0, np.array(start)))
    keys = {'goal', 'goal_x', 'heading_error', 'goals_received'}
    assert not keys & set(decision_to_key_values(decision))


@pytest.mark.parametrize('heading', [0.6, 3.0])
def test_a_heading_is_met_exactly(heading):
    given, start = preset('corridor', goal_heading=heading)
    run = drive(GuidanceLaw(given, given.world), given, [k * PERIOD for k in range(101)], start)
    assert run.miss(given.goal) < 1e-6
    assert off(run.pose[2], heading) < 1e-6
    assert run.decisions[-1].heading_error < 1e-6
    assert not run.decisions[-1].missed


def message(x=0.0, y=0.0, heading=0.0, frame='odom', length=1.0, stamp=0):
    z, w = length * math.sin(heading / 2.0), length * math.cos(heading / 2.0)
    seconds, rest = divmod(stamp, 1_000_000_000)
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=frame, stamp=SimpleNamespace(sec=seconds, nanosec=rest)),
        pose=SimpleNamespace(
            position=SimpleNamespace(x=x, y=y, z=0.0),
            orientation=SimpleNamespace(x=0.0, y=0.0, z=z, w=w),
        ),
    )


def test_what_a_message_says():
    stamp, goal = goal_of(message(1.0, 2.0, -2.5, stamp=1_500_000_000), 'odom')
    assert stamp == 1_500_000_000
    assert goal.position == (1.0, 2.0)
    assert goal.heading == pytest.approx(-2.5)
    assert goal_of(message(length=0.0), 'odom')[1].heading is None


def assert_refused(fault, call, why):
    """It is refused for this, and that is its row of doc/reference/faults.md."""
    with pytest.raises(GoalError, match=why) as caught:
        call()
    fault.assert_said('—', 1, str(caught.value))


def without_heading():
    broken = message()
    broken.pose.orientation.z = math.nan
    return broken


def test_messages_that_are_refused(fault):
    with pytest.raises(GoalError, match="in frame 'map', wanted 'odom'"):
        goal_of(message(frame='map'), 'odom')
    for broken, why in (
        (message(x=math.nan), 'not finite'),
        (without_heading(), 'not finite'),
        (message(length=0.5), 'orientation of length 0.5'),
        (message(y=1e9), 'wanted one on Earth'),
    ):
        assert_refused(fault, lambda broken=broken: goal_of(broken, 'odom'), why)


def test_places_that_are_refused(fault):
    given, start = preset('corridor')
    for position, why in (
        ((0.0, 3.0), 'inside or beyond'),
        ((3.0, 3.3), 'inside or beyond obstacle a'),
        ((-4.743, -3.62), 'beyond the end of the road'),
    ):
        law, goal = GuidanceLaw(given, given.world), Goal(position, 0.0)
        before = law.step(Observation(0, np.array(start)))
        assert_refused(fault, lambda law=law, goal=goal: law.set_goal(0, goal), why)
        after = law.step(Observation(PERIOD, before.plan.poses[1]))
        assert after.goal == before.goal
        assert after.goals_received == 1


def test_where_a_road_is_followed_no_goal_is_taken(fault):
    given, start = preset('endless')
    law, twin = GuidanceLaw(given, given.world), GuidanceLaw(given, given.world)
    pose = np.array(start)
    place, goal = law.step(Observation(0, pose)).plan.poses[1], Goal((start[0], start[1]), 0.0)
    twin.step(Observation(0, pose))
    assert_refused(fault, lambda: law.set_goal(0, goal), 'takes no goal')
    for each in (law.step(Observation(PERIOD, place)), twin.step(Observation(PERIOD, place))):
        assert each.goal is None
        assert each.wheel_speeds.any()


def test_a_goal_of_a_time_that_is_not_is_refused_and_one_of_later_waits(fault):
    given, start = preset('corridor')
    law, goal = GuidanceLaw(given, given.world), Goal((0.939, 1.082), 0.0, None, 'goal_pose')
    decision = law.step(Observation(0, np.array(start)))
    assert_refused(fault, lambda: law.set_goal(10 * PERIOD, goal), 'ahead of the last odometry')
    law.set_goal(2 * PERIOD, goal)
    names = []
    for k in range(1, 4):
        decision = law.step(Observation(k * PERIOD, decision.plan.poses[1]))
        names.append(decision.goal.name)
    assert names == ['', 'goal_pose', 'goal_pose']


def test_a_goal_is_driven_to_under_way_and_after_the_end():
    given, start = preset('corridor')
    law, reached = GuidanceLaw(given, given.world), []

    def tell(run, stamp):
        if stamp == 25 * PERIOD:
            law.set_goal(0, Goal((0.939, 1.082), 0.0, 0.86, 'goal_pose'))
        if run.decisions and run.decisions[-1].finished and len(reached) < 2:
            reached.append(
                (run.decisions[-1].terminal_error, run.decisions[-1].heading_error, stamp)
            )
            law.set_goal(stamp, Goal((4.243, 3.5), 0.0, None, 'goal_pose'))

    run = drive(law, given, [k * PERIOD for k in range(120)], start, before=tell)
    (first, first_heading, at), (second, _, _) = reached
    assert max(first, second) < 1e-6
    assert first_heading < 1e-6
    # In a time that the way, the pace and two turns say.
    assert at < 70 * PERIOD
    assert {decision.level for decision in run.moves} <= SETTLED
    # The second one is passed through and stopped at: nobody has told another since.
    assert run.decisions[-1].goals_received == 3


@pytest.mark.parametrize('heading', [None, 2.2])
def test_a_goal_is_held(fault, heading):
    given, start = preset('corridor', hold=True, goal_heading=heading)
    pushed = np.array([0.05, 0.08, 0.3])

    def push(run, stamp):
        if stamp == 110 * PERIOD:
            run.pose = run.pose + pushed

    run = drive(
        GuidanceLaw(given, given.world), given, [k * PERIOD for k in range(160)], start, before=push
    )
    assert run.decisions[105].finished
    assert not run.decisions[111].finished
    back = run.decisions[115]
    fault.assert_said(back.level.name.lower(), severity(back), back.reason)
    assert run.decisions[-1].finished
    assert run.miss(given.goal) < 1e-6
    assert heading is None or off(run.pose[2], heading) < 1e-6


def test_without_hold_the_robot_stays_where_it_was_moved():
    given, start = preset('corridor')

    def push(run, stamp):
        if stamp == 110 * PERIOD:
            run.pose = run.pose + np.array([0.05, 0.08, 0.3])

    run = drive(
        GuidanceLaw(given, given.world), given, [k * PERIOD for k in range(130)], start, before=push
    )
    assert all(decision.finished for decision in run.decisions[100:])
    assert run.miss(given.goal) > 0.09


ORIGIN = np.zeros(3)


def settings(preset='case3', **changes):
    given = {key.replace('_of_', '.'): value for key, value in changes.items()}
    return guidance_settings(TABLE.resolve({**load_parameter_file(preset), **given}))


@pytest.mark.parametrize('name', preset_names())
def test_every_preset_may_begin_where_its_robot_is(name):
    values = TABLE.resolve(load_parameter_file(name, namespace='/r1'))
    assert not reason_not_to_begin(guidance_settings(values), np.array(values['initial_pose']))


def test_odometry_that_begins_at_the_origin_with_a_course_elsewhere():
    assert reason_not_to_begin(settings(), ORIGIN) == (
        'The robot is 9 m off the road, more than 0.5 m (start.tolerance): no run begins there.'
    )


@pytest.mark.parametrize(('y', 'begins'), [(-11.49, True), (-11.51, False), (-8.51, True)])
def test_beside_the_road_the_tolerance_counts(y, begins):
    assert (not reason_not_to_begin(settings(), np.array([0.0, y, 0.0]))) == begins


def test_a_corridor_has_ends_too():
    road = settings('corridor').road
    (first, second) = np.array(road.points[:2])
    before = first - 0.7 * (second - first) / np.linalg.norm(second - first)
    pose = np.array([*before, 0.0])
    assert ' m off the road, more than 0.5 m' in reason_not_to_begin(settings('corridor'), pose)
    assert not reason_not_to_begin(settings('corridor', start_of_tolerance=1.0), pose)


def test_open_floor_is_everywhere():
    assert not reason_not_to_begin(settings('floor'), np.array([1e3, 1e3, 0.0]))


def test_a_start_that_is_given_counts_instead_of_the_road():
    given = settings(start_of_pose=[0.0, -9.25, 0.0])
    assert not reason_not_to_begin(given, np.array([0.3, -9.25, 2.0]))
    assert reason_not_to_begin(given, np.array([3.0, -9.25, 0.0])) == (
        'The robot is 3 m from start.pose, more than 0.5 m (start.tolerance): no run begins there.'
    )
    with pytest.raises(ParameterError, match=r'start\.pose'):
        settings(start_of_pose=[0.0, 1.0])
