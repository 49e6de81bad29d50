"""The law told of a delay, on a robot that has one."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scenarios import CASES, FIRST, MS, PERIOD, ROAD, START, assert_is, reconfigure, settings

from cmpsp_ros.guidance import FallbackLevel, Goal, GuidanceLaw, Observation, Safety
from cmpsp_ros.guidance.prediction.pending_commands import PendingCommands
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import Plant, PlantSettings
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle

ODOMETRY = 20 * MS
CASE_3 = CASES['case 3']
UNCORRECTED = replace(CASE_3, delay_tolerance=0.0)


class Drive:
    """A law and a robot with disturbances, odometry at 50 Hz, up to the final time or later."""

    def __init__(self, given, beyond=0, **disturbances):
        self.law = GuidanceLaw(given, given.world)
        self.plant = Plant(PlantSettings(given.robot, START, **disturbances))
        self.decisions, self.motions, self.poses = [], [self.plant.motion], {}
        self.settings, self.goal = given, given.goal
        final = round(given.final_time * 1e9)
        for stamp in range(0, final + beyond + 1, ODOMETRY):
            self.motions += self.plant.advance(stamp)
            self.poses[stamp] = self.plant.pose
            if stamp == final:
                self.miss = math.dist(self.plant.pose[:2], self.goal)
            decision = self.law.step(Observation(stamp, self.plant.measure()))
            if decision is not None:
                self.decisions.append(decision)
                self.plant.command(stamp, *decision.twist)
        self.motions.append(self.plant.motion)

    @property
    def clearance(self):
        space = FreeSpace.of(self.settings.road, self.settings.obstacles, 0.0)
        poses = np.array([each.pose for each in self.motions[:-1]])
        twists = np.array([each.twist for each in self.motions[:-1]])
        durations = np.diff([each.stamp_ns for each in self.motions]) / 1e9
        return space.along(poses, twists, durations).min()


def test_told_of_its_delay_the_robot_arrives_as_it_does_without():
    undelayed = Drive(CASE_3)
    untold = Drive(UNCORRECTED, actuation_delay=0.06)
    told = Drive(replace(CASE_3, command_delay=0.06), actuation_delay=0.06)
    assert undelayed.miss < 1e-9
    assert undelayed.clearance == pytest.approx(0.0634, abs=1e-3)
    assert untold.miss > 1e-3
    assert told.miss < 1e-9
    assert told.clearance == pytest.approx(0.0640, abs=1e-3)
    assert {each.level for each in told.decisions[:-1]} == {FallbackLevel.NOMINAL}


@pytest.mark.parametrize(
    ('name', 'delay'),
    [
        *(('case 3', each) for each in (0.01, 0.11, 0.2, 0.25, 0.5)),
        ('case 1', 0.5),
        ('case 2', 0.2),
    ],
)
def test_any_delay_that_is_known_is_made_up_for(name, delay):
    run = Drive(replace(CASES[name], command_delay=delay), actuation_delay=delay)
    assert run.miss < 1e-9
    assert run.clearance > 0.02
    assert {each.level for each in run.decisions if not each.finished} == {FallbackLevel.NOMINAL}


@pytest.mark.parametrize('delay', [0.06, 0.25])
def test_every_plan_begins_where_the_robot_then_is(delay):
    run = Drive(replace(CASE_3, command_delay=delay), beyond=1000 * MS, actuation_delay=delay)
    for decision in run.decisions:
        if decision.plan is None:
            continue
        stamps = decision.plan.stamps(decision.stamp)
        assert stamps[0] == decision.stamp + round(delay * 1e9)
        nearest = stamps[0] - stamps[0] % ODOMETRY
        [first] = [m for m in run.motions if m.stamp_ns == stamps[0]][-1:] or [None]
        if first is not None:
            assert np.allclose(decision.plan.poses[0], first.pose, atol=1e-9)
        elif stamps[0] == nearest:
            assert np.allclose(decision.plan.poses[0], run.poses[nearest], atol=1e-9)


def test_a_wheel_that_lags_is_mostly_a_delay():
    # The mean speed of a lagging wheel is that of a delayed one.
    untold = Drive(UNCORRECTED, wheel_lag=0.1)
    told = Drive(replace(UNCORRECTED, command_delay=0.1), wheel_lag=0.1)
    assert untold.miss > 0.03
    assert told.miss < 2e-3
    assert told.clearance > 0.03


def test_where_a_command_would_come_too_late_the_plan_goes_on(fault):
    run = Drive(replace(CASE_3, command_delay=0.25), beyond=1000 * MS, actuation_delay=0.25)
    before, last, end = [each for each in run.decisions if each.stamp >= 9600 * MS][:3]
    assert 'goes on' not in before.reason
    assert last.stamp == 9800 * MS
    assert_is(fault, last)
    assert (last.wheel_speeds == before.wheel_speeds).all()
    assert last.terminal_error == before.terminal_error
    assert (end.stamp, end.finished) == (10_000 * MS, True)


def test_without_a_plan_nothing_goes_on(fault):
    given = replace(CASE_3, command_delay=0.25)
    law = GuidanceLaw(given, given.world)
    law.step(Observation(0, np.array(START)))
    law.halt(9700 * MS, 'Odometry was lost.')
    decision = law.step(Observation(9800 * MS, np.array(START)))
    assert decision.level == FallbackLevel.STOP
    assert not decision.finished
    assert_is(fault, decision)


@pytest.mark.parametrize('delay', [0.06, 0.11, 0.2, 0.3])
def test_where_the_last_command_may_not_outlast_the_final_time_a_stop_is_given_in_time(delay):
    # Just behind the goal, where the robot comes only after the final time.
    wall = Obstacle('wall', (10.0, 0.45), 0.3)
    near = settings((wall,), 51.0, command_delay=delay)
    assert Drive(replace(near, command_delay=0.0)).miss < 1e-9
    run = Drive(near, beyond=1000 * MS, actuation_delay=delay)
    assert run.miss < 1e-9
    assert run.clearance > 0.0
    final = round(near.final_time * 1e9)
    stops = [each for each in run.decisions if each.level == FallbackLevel.STOP]
    outlasts = 1.6 * delay < 0.15
    given = final if outlasts else final - round(delay * 1e9)
    assert stops[0].stamp == min(at for at in run.poses if at >= given)


@pytest.mark.parametrize(('time', 'delay'), [(2.4, 0.11), (2.5, 0.2), (2.6, 0.11)])
def test_the_last_command_on_the_way_to_a_waypoint_does_not_lead_into_what_is_behind(time, delay):
    place, heading = (3.83, -9.24), 0.3
    behind = (place[0] + 0.42 * math.cos(heading), place[1] + 0.42 * math.sin(heading))
    given = settings(
        (Obstacle('wall', behind, 0.3),),
        51.0,
        ROAD,
        command_delay=delay,
        waypoints=(Goal(place, time, heading, 'first'),),
    )
    run = Drive(given, actuation_delay=delay)
    assert run.clearance > 0.03
    assert math.dist(run.poses[round(time * 1e9)][:2], place) < 0.05
    assert run.miss < 1e-6


def test_behind_the_goal_the_margin_is_kept_as_well():
    """Without a margin the last command may outlast the final time here."""
    wall = Obstacle('wall', (10.0, 0.45), 0.3)
    near = settings((wall,), 51.0, command_delay=0.06)
    bare = Drive(near, beyond=1000 * MS, actuation_delay=0.06)
    kept = Drive(replace(near, safety=Safety(margin=0.1)), beyond=1000 * MS, actuation_delay=0.06)
    assert 0.0 < bare.clearance < 0.1 - 1e-2
    assert kept.clearance > 0.1 - 1e-2
    assert kept.miss < 2e-2


def test_the_way_under_commands_given_is_swept_too(fault):
    given = replace(CASE_3, command_delay=0.4)
    law, plant = (
        GuidanceLaw(given, given.world),
        Plant(PlantSettings(given.robot, START, actuation_delay=0.4)),
    )
    for k in range(11):
        stamp = k * PERIOD
        plant.advance(stamp)
        decision = law.step(Observation(stamp, plant.pose))
        plant.command(stamp, *decision.twist)
    assert decision.level == FallbackLevel.NOMINAL
    stamp += PERIOD
    plant.advance(stamp)
    # Within the 0.6 m that the robot goes before any new command could take effect.
    x, y, heading = plant.pose
    ahead = (float(x + 0.35 * math.cos(heading)), float(y + 0.35 * math.sin(heading)))
    reconfigure(law, replace(given, obstacles=(*given.obstacles, Obstacle('box', ahead, 0.1))))
    decision = law.step(Observation(stamp, plant.pose))
    assert decision.level == FallbackLevel.STOP
    assert_is(fault, decision)
    assert decision.reason.startswith('The commands given before come 0.')
    assert decision.reason.endswith('too close to obstacle box.')


def test_margins_are_those_of_the_way_as_well():
    # Beside the robot as it stands, and left behind before its first command takes effect.
    given = settings((FIRST, Obstacle('post', (0.0, -9.6), 0.3)), 51.0, command_delay=0.3)
    decision = GuidanceLaw(given, given.world).step(Observation(0, np.array(START)))
    assert decision.clearance == pytest.approx(0.05)
    assert decision.worst_clearance <= 0.05 + 1e-12


def test_a_reset_forgets_the_commands():
    given = replace(CASE_3, command_delay=0.3)
    law, fresh = GuidanceLaw(given, given.world), GuidanceLaw(given, given.world)
    pose = np.array(START)
    first = law.step(Observation(0, pose))
    law.step(Observation(PERIOD, pose))
    law.reset()
    again, same = law.step(Observation(2 * PERIOD, pose)), fresh.step(Observation(0, pose))
    for each in (again, same):
        assert (each.wheel_speeds == first.wheel_speeds).all()
        assert (each.plan.poses == first.plan.poses).all()


def test_a_stop_by_the_clock_is_foreseen_as_well():
    given = replace(CASE_3, command_delay=0.3)
    law, pose = GuidanceLaw(given, given.world), np.array(START)
    law.step(Observation(0, pose))
    law.halt(100 * MS, 'Odometry was lost.')
    decision = law.step(Observation(500 * MS, pose))
    assert (decision.plan.poses[0] == pose).all()


MILLI = 1_000_000
SECOND = 1000 * MILLI
ROBOT = DifferentialDrive()
unhurried = hypothesis_settings(deadline=None)
"""The first call of a kernel compiles it."""

gaps = st.integers(1, 400 * MILLI)
speeds = st.tuples(*[st.floats(-50.0, 50.0)] * 2).map(np.array)
commands = st.lists(st.tuples(gaps, speeds), max_size=8)


@unhurried
@given(commands, gaps, st.integers(0, 700 * MILLI))
def test_the_robot_is_where_it_was_foreseen_to_be_when_a_command_takes_effect(given_, now, delay):
    settings = PlantSettings(ROBOT, cmd_vel_timeout=0.0, actuation_delay=delay / SECOND)
    plant, under_way, stamp = Plant(settings), PendingCommands(), 0
    for gap, wheel_speeds in given_:
        stamp += gap
        under_way.add(stamp, wheel_speeds)
        plant.command(stamp, *ROBOT.twist(wheel_speeds))
    stamp += now
    plant.advance(stamp)
    wheel_speeds, durations = under_way.until(stamp, delay)
    foreseen = ROBOT.roll_out(plant.pose, wheel_speeds, durations)[-1]
    plant.advance(stamp + delay)
    assert np.allclose(foreseen, plant.pose, atol=1e-9)
    assert np.isclose(durations.sum(), delay / SECOND, atol=1e-12)


def test_without_a_delay_nothing_is_under_way():
    under_way = PendingCommands()
    under_way.add(0, np.array([1.0, 2.0]))
    wheel_speeds, durations = under_way.until(SECOND, 0)
    assert wheel_speeds.shape == (0, 2)
    assert durations.shape == (0,)


def test_at_first_the_robot_stands_still():
    wheel_speeds, durations = PendingCommands().until(0, 60 * MILLI)
    assert wheel_speeds.tolist() == [[0.0, 0.0]]
    assert durations.tolist() == [0.06]


def test_the_command_in_force_is_followed_by_those_under_way():
    under_way = PendingCommands()
    for k in range(4):
        under_way.add(k * 100 * MILLI, np.full(2, k + 1.0))
    wheel_speeds, durations = under_way.until(400 * MILLI, 250 * MILLI)
    assert wheel_speeds[:, 0].tolist() == [2.0, 3.0, 4.0]
    assert np.allclose(durations, [0.05, 0.1, 0.1])


def test_a_command_by_the_clock_may_be_ahead_of_odometry_and_is_not_overtaken():
    under_way = PendingCommands()
    under_way.add(0, np.ones(2))
    under_way.add(500 * MILLI, np.zeros(2))
    under_way.add(450 * MILLI, np.full(2, 3.0))
    wheel_speeds, durations = under_way.until(550 * MILLI, 100 * MILLI)
    assert wheel_speeds.tolist() == [[1.0, 1.0], [3.0, 3.0]]
    assert np.allclose(durations, [0.05, 0.05])
