"""Goals that are passed as early as possible: the choice of the final time, in closed loop."""

import math

import numpy as np
import pytest

from cmpsp_ros.guidance import FallbackLevel, Goal, GuidanceLaw, Observation
from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, load_parameter_file

SOONEST = {
    'goal.when': 'soonest',
    'robot.max_wheel_speed': 40.0,
    'robot.max_wheel_acceleration': 40.0,
}
FLOOR = {**SOONEST, 'road.type': 'none', 'goal.position': [6.0, 0.0], 'initial_pose': [0.0] * 3}
TOP, CHANGE, PERIOD = 1.4, 0.28, 0.2
"""Largest speed, its largest change [m/s], and the control period [s]."""


class Drive:
    """A run by exact arcs, with odometry at control instants and at the final time."""

    def __init__(self, preset, changes, pushes=None, goals=None, paths=None):
        given = {**load_parameter_file(preset), **changes}
        if 'obstacles.names' in changes:
            given = {k: v for k, v in given.items() if not k.startswith('obstacles.')}
        values = TABLE.resolve(given)
        self.settings = guidance_settings(values)
        self.law = GuidanceLaw(self.settings, self.settings.world)
        self.decisions, self.poses, pose, stamp = [], [], np.array(values['initial_pose']), 0
        pushes, goals = pushes or {}, goals or {}
        while not self.decisions or not self.decisions[-1].finished:
            assert stamp < 60e9
            pose = pose + pushes.get(len(self.decisions), 0.0)
            if path := (paths or {}).get(len(self.decisions)):
                # As the node does with the path of an action.
                self.settings = guidance_settings(TABLE.resolve({**given, **path}))
                self.law.reconfigure(self.settings, self.settings.world)
                goals[len(self.decisions)] = Goal(self.settings.goal, 0.0)
            if len(self.decisions) in goals:
                self.law.set_goal(stamp, goals[len(self.decisions)])
            decision = self.law.step(Observation(stamp, pose))
            self.law.after_step()
            self.decisions.append(decision)
            self.poses.append(pose)
            period = round(self.settings.control_period * 1e9)
            last = self.law.ends_at
            length = last - stamp if stamp < last < stamp + 1.5 * period else period
            held = self.settings.robot.controls(decision.twist)[None]
            pose = self.settings.robot.roll_out(pose, held, np.array([length / 1e9]))[-1]
            stamp += length

    @property
    def time(self):
        return self.decisions[-1].stamp / 1e9

    @property
    def levels(self):
        return {each.level for each in self.decisions[:-1]}


@pytest.fixture(scope='module')
def straight():
    return Drive('case1', FLOOR)


def test_a_straight_way_takes_hardly_longer_than_it_must(straight):
    # Speed rises and falls by steps: at its ends it is as if a step less were lost than by ramps.
    least = 6.0 / TOP + (TOP / CHANGE - 1.0) * PERIOD
    assert least <= straight.time <= 1.01 * least
    assert straight.decisions[-1].terminal_error < 1e-6
    assert not straight.decisions[-1].missed
    assert straight.levels == {FallbackLevel.NOMINAL}


def test_it_comes_to_rest_at_the_goal_without_chatter(straight):
    speeds = [each.twist[0] for each in straight.decisions]
    changes = np.diff(speeds, prepend=0.0)
    assert np.abs(changes).max() <= CHANGE + 1e-9
    assert speeds[-1] == 0.0
    signs = [math.copysign(1.0, each) for each in changes if abs(each) > 0.02]
    assert signs == sorted(signs, reverse=True)


def test_the_same_odometry_gives_the_same_decisions(straight):
    again = Drive('case1', FLOOR)
    assert [each.reason for each in again.decisions] == [each.reason for each in straight.decisions]
    assert np.array_equal(again.poses, straight.poses)
    assert again.decisions[-1].goal == straight.decisions[-1].goal


def test_no_control_instant_before_the_end_is_left_out():
    run = Drive('case3', {'goal.when': 'soonest'})
    period = round(run.settings.control_period * 1e9)
    for decision in run.decisions:
        beyond = round(decision.goal.time * 1e9) % period
        assert beyond == 0 or beyond >= period // 2
    assert [each.stamp for each in run.decisions[:-1]] == [
        step * period for step in range(len(run.decisions) - 1)
    ]


def test_a_robot_that_is_set_back_arrives_later_and_not_elsewhere(straight):
    pushed = Drive('case1', FLOOR, pushes={10: np.array([-0.5, 0.1, 0.05])})
    assert straight.time + 0.2 < pushed.time < straight.time + 1.0
    assert pushed.decisions[-1].terminal_error < 1e-3
    assert [each.level for each in pushed.decisions].count(FallbackLevel.NOMINAL) > 20


def test_one_that_is_set_forward_arrives_earlier(straight):
    pushed = Drive('case1', FLOOR, pushes={10: np.array([0.5, 0.0, 0.0])})
    assert pushed.time < straight.time - 0.2
    assert pushed.decisions[-1].terminal_error < 1e-3


def test_a_road_is_cut_short():
    changes = {**SOONEST, 'safety.margin': 0.05, 'initial_pose': [0.0, -9.25, 0.0]}
    run = Drive('case1', changes)
    radii = [math.hypot(*each[:2]) for each in run.poses]
    # Along the centre line it takes 12 s.
    assert run.time < 11.5
    assert min(radii) > 9.05
    assert run.levels == {FallbackLevel.NOMINAL}


def test_waypoints_are_passed_at_whatever_control_instants_suit():
    run = Drive('goals', {'goal.when': 'soonest'})
    assert run.levels == {FallbackLevel.NOMINAL}
    assert run.time < 30.0
    passed = {}
    for decision in run.decisions:
        passed[decision.goal.name] = decision.goal
    assert list(passed) == ['a', 'b', 'c', 'd', 'e', 'goal']
    stamps = [each.stamp for each in run.decisions]
    for goal in passed.values():
        at = stamps.index(round(goal.time * 1e9))
        assert math.dist(run.poses[at][:2], goal.position) < 1e-6
        assert goal.name == 'goal' or stamps[at] % round(PERIOD * 1e9) == 0


@pytest.mark.parametrize('ahead', [0.0, 1e-4, -0.05])
def test_a_horizon_that_takes_too_much_work_is_made_shorter(ahead):
    """Whichever horizon the work suffices for, it ends with the goal's heading.

    While it brakes as hard as it can, only a later final time leaves any choice.
    """
    # At a moderate speed the car would take 260 control periods.
    run = Drive('lane_change', {'goal.when': 'soonest', 'initial_pose': [ahead, 0.0, 0.0]})
    assert run.time < 11.5
    assert FallbackLevel.STOP not in run.levels
    assert not run.decisions[-1].missed


def test_a_path_that_becomes_the_road_is_driven_as_early():
    straight = {'road.points': [0.0, 0.0, 5.0, 0.0], 'goal.position': [5.0, 0.0]}
    road = {**SOONEST, 'obstacles.names': [], 'road.half_width': [0.6], 'initial_pose': [0.0] * 3}
    line = [-0.5, 0.0, 2.0, 0.0, 4.0, 1.0, 5.0, 3.0]
    bent = {'road.points': line, 'goal.position': line[-2:]}
    run = Drive('corridor', {**road, **straight}, paths={5: bent})
    assert run.decisions[-1].goal.position == (5.0, 3.0)
    assert not run.decisions[-1].missed
    assert run.levels == {FallbackLevel.NOMINAL}
    # It has set out already, and the path is 6 m long.
    assert run.time < 1.1 * (6.0 / TOP + (TOP / CHANGE - 1.0) * PERIOD)


def test_a_goal_that_is_received_is_reached_as_early():
    run = Drive('case1', FLOOR, goals={8: Goal((3.0, 3.0), 0.0)})
    assert run.decisions[-1].goal.position == (3.0, 3.0)
    assert run.decisions[-1].terminal_error < 1e-6
    assert run.time < 1.6 + 4.5


def test_a_command_that_takes_effect_later_is_planned_for():
    run = Drive('case1', {**FLOOR, 'command_delay': 0.1, 'goal.position': [4.0, 1.0]})
    assert run.decisions[0].level is FallbackLevel.NOMINAL
    assert run.decisions[0].goal.time < 4.6


def test_a_car_stops_at_its_goal():
    run = Drive('three_point_turn', {'goal.when': 'soonest'})
    assert run.decisions[-1].terminal_error < 0.01
    assert run.time < run.settings.final_time


@pytest.mark.parametrize(
    ('preset', 'key', 'text'),
    [
        ('case1', 'robot.max_wheel_speed', 'more than 0, for goal.when = soonest'),
        ('endless', 'goal.when', 'fixed with follow.speed'),
    ],
)
def test_without_a_limit_or_a_goal_there_is_no_earliest_time(preset, key, text):
    given = {**load_parameter_file(preset), 'goal.when': 'soonest'}
    with pytest.raises(ParameterError, match=text) as caught:
        guidance_settings(TABLE.resolve(given))
    assert key in str(caught.value)


def test_an_unknown_word_is_refused():
    given = {**load_parameter_file('case3'), 'goal.when': 'asap'}
    with pytest.raises(ParameterError, match=r"goal\.when: found 'asap', wanted fixed or soonest"):
        TABLE.resolve(given)


def test_between_shelves_the_earliest_plan_keeps_a_reserve():
    # With none, nearly every step would need slack: the earliest plan is the last that exists.
    drive = Drive('warehouse', {'goal.when': 'soonest'})
    assert drive.levels == {FallbackLevel.NOMINAL}
    assert drive.time < 47.0
