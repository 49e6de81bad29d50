"""The guidance law with wheels of limited acceleration: it can always stop in time."""

from dataclasses import replace

import numpy as np
import pytest
from scenarios import (
    CASES,
    PERIOD,
    ROAD,
    START,
    clearance,
    closed_loop,
    context_of,
    drive,
    reconfigure,
    settings,
    start_of,
)

from cmpsp_ros.guidance import (
    FallbackLevel,
    Goal,
    GuidanceLaw,
    Observation,
    Safety,
    remaining,
    to_nanoseconds,
)
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import Planner
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING, Validator
from cmpsp_ros.mpsp.qp import CLARABEL
from cmpsp_ros.world.obstacles import Obstacle

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('control_rate')

LIMIT, FINAL = 30.0, 12.0
STEPS = round(FINAL / 0.2)


def limited(given, acceleration=LIMIT, **changes):
    robot = replace(given.robot, max_wheel_acceleration=acceleration)
    return replace(given, robot=robot, final_time=FINAL, initial_guess=ROAD, **changes)


WALL = tuple(Obstacle(f'wall {r:g}', (r, 0.0), 0.15) for r in np.arange(9.0, 11.1, 0.25))


def assert_gentle(run, given):
    """Every command can be followed from the one before it, and the first from rest."""
    changes = np.diff(run.controls, axis=0, prepend=np.zeros((1, 2)))
    assert np.abs(changes).max() <= given.max_wheel_change + CHANGE_ROUNDING


@pytest.mark.parametrize('name', ['case 1', 'case 3'])
@pytest.mark.parametrize('acceleration', [LIMIT, 100.0])
def test_the_robot_sets_out_arrives_and_brakes_gently(name, acceleration):
    given = limited(CASES[name], acceleration)
    run = closed_loop(given, steps=STEPS + 10)
    assert_gentle(run, given)
    assert {each.level for each in run.moves} == {FallbackLevel.NOMINAL}
    final = run.decisions[STEPS]
    assert final.finished
    assert not final.missed
    assert final.terminal_error < 1e-6
    # It drives through the goal, and comes to rest behind it.
    assert 'It brakes to' in final.reason
    assert 0.0 < final.twist[0] < run.decisions[STEPS - 1].twist[0]
    assert not np.any(run.decisions[-1].wheel_speeds)
    assert clearance(run.path, given) >= 0.0


def test_after_every_command_there_is_a_clear_way_to_stop():
    given = limited(CASES['case 3'])
    run, previous, pose = closed_loop(given, steps=STEPS), np.zeros(2), np.array(START)
    validator, durations = Validator(given), np.full(40, 0.2)
    for decision in run.moves:
        start = start_of(given, pose, previous_control=previous)
        verdict = validator.check(start, decision.plan.controls, decision.plan.horizon.durations)
        assert verdict.passed
        ramp = verdict.ramp
        assert np.abs(np.diff(ramp, axis=0, prepend=decision.wheel_speeds[None])).max() < 6.0 + 1e-6
        previous = decision.wheel_speeds
        pose = given.robot.roll_out(pose, previous[None], durations[:1])[-1]
        fine = np.repeat(ramp, 20, axis=0)
        path = given.robot.roll_out(pose, fine, np.full(len(fine), 0.01))
        assert clearance(path, given) > -1e-6


@pytest.mark.parametrize('acceleration', [15.0, LIMIT])
def test_before_a_closed_road_it_stops_clear(acceleration):
    given = limited(settings(WALL, 51.0, ROAD), acceleration, goal=(0.0, 10.0))
    run = closed_loop(given, steps=STEPS + 5)
    assert_gentle(run, given)
    assert clearance(run.path, given) > 0.0
    assert not np.any(run.decisions[-1].wheel_speeds)
    # It came near it.
    assert clearance(run.path[-1:], given) < 3.0


def test_a_stop_is_the_ramp_that_was_audited():
    """The law is told of an obstacle where its plan leads: no plan is left, and it brakes."""
    # It is not slowed down before.
    given = limited(CASES['case 1'], safety=Safety(stopping_time=0.0))

    def block(run, _stamp):
        if len(run.decisions) == 20:
            ahead = np.arctan2(run.pose[1], run.pose[0]) + 0.26
            center = 10.0 * np.cos(ahead), 10.0 * np.sin(ahead)
            reconfigure(law, replace(given, obstacles=(Obstacle('new', center, 0.95),)))

    law = GuidanceLaw(given, given.world)
    run = drive(law, given, [k * PERIOD for k in range(40)], before=block)
    assert_gentle(run, given)
    stops = [each for each in run.decisions if each.level == FallbackLevel.STOP]
    assert stops
    assert all('It brakes to' in each.reason or not np.any(each.twist) for each in stops)
    assert clearance(run.path, law.task) > 0.0


def test_a_halt_is_at_once_but_for_the_final_time():
    given = limited(CASES['case 1'])
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, [k * PERIOD for k in range(10)])
    held = run.decisions[-1].wheel_speeds
    by_clock = law.halt(9 * PERIOD + PERIOD, 'The final time has passed.', finished=True)
    assert 0.0 < np.abs(held - by_clock.wheel_speeds).max() <= 6.0 + CHANGE_ROUNDING
    # The next odometry comes at once, and the ramp goes on when a period is over.
    again = law.step(Observation(10 * PERIOD + PERIOD // 10, run.pose))
    assert again is not None
    halted = law.halt(11 * PERIOD, 'Odometry is lost.')
    np.testing.assert_array_equal(halted.wheel_speeds, [0.0, 0.0])
    np.testing.assert_array_equal(halted.twist, [0.0, 0.0])


def test_every_command_of_the_stop_after_the_final_time_is_held_for_a_period():
    given = limited(CASES['case 1'])
    law, end = GuidanceLaw(given, given.world), STEPS * PERIOD
    run = drive(law, given, [k * PERIOD for k in range(STEPS)])
    stop = law.halt(end + PERIOD // 40, 'The final time has passed.', finished=True)
    commands = [(stop.stamp, stop.wheel_speeds)]
    for stamp in range(end + PERIOD // 8, end + 9 * PERIOD, PERIOD // 40):
        decision = law.step(Observation(stamp, run.pose))
        if decision is not None and not np.array_equal(decision.wheel_speeds, commands[-1][1]):
            commands.append((stamp, decision.wheel_speeds))
    assert not commands[-1][1].any()
    assert len(commands) > 5
    assert {*np.diff([stamp for stamp, _ in commands]).tolist()} == {PERIOD}


@pytest.mark.parametrize('ahead', [-150_000_000, 0, 150_000_000])
def test_the_node_brakes_period_by_period_by_a_clock_beside_that_of_odometry(ahead):
    given = limited(CASES['case 1'])
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, [k * PERIOD for k in range(10)])
    speeds = [run.decisions[-1].wheel_speeds]
    for k in range(10, 14):
        decision = law.halt(k * PERIOD - ahead, 'No odometry.', braking=True)
        speeds.append(decision.wheel_speeds)
    changes = np.abs(np.diff(speeds, axis=0)).max(axis=1)
    assert ((changes > 5.9) & (changes <= 6.0 + CHANGE_ROUNDING)).all()


def test_a_goal_that_is_cancelled_ends_in_a_gentle_stop_and_the_next_one_is_driven_to():
    given = limited(CASES['case 1'])
    law, run, stamp = GuidanceLaw(given, given.world), None, 0
    run = drive(law, given, [k * PERIOD for k in range(10)])
    wheels, pose = [run.decisions[-1].wheel_speeds], run.pose
    while np.any(wheels[-1]):
        stamp = (10 + len(wheels)) * PERIOD
        stop = law.halt(stamp, 'The goal was cancelled.', cancelled=True)
        wheels.append(stop.wheel_speeds)
        pose = given.robot.roll_out(pose, stop.wheel_speeds[None], np.array([0.2]))[-1]
    assert len(wheels) > 3
    assert np.abs(np.diff(wheels, axis=0)).max() <= given.max_wheel_change + CHANGE_ROUNDING
    law.set_goal(0, Goal((10.0, 0.0), 0.0))
    assert np.any(law.step(Observation(stamp + PERIOD, pose)).wheel_speeds)


def test_a_new_goal_behind_the_robot_is_turned_to_gently():
    given = limited(settings((), 51.0, ROAD))
    law = GuidanceLaw(given, given.world)

    def turn(run, stamp):
        if len(run.decisions) == 15:
            law.set_goal(stamp, Goal((-10.0, 0.0), 20.0))

    run = drive(law, given, [k * PERIOD for k in range(60)], before=turn)
    assert_gentle(run, given)
    assert clearance(run.path, given) > 0.0


@pytest.mark.parametrize('delay', [0.06, 0.3])
def test_with_a_delay_the_last_command_counts(delay):
    given = limited(CASES['case 3'], command_delay=delay)
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, [k * PERIOD for k in range(30)])
    assert_gentle(run, given)


@pytest.mark.parametrize('qp', ['riccati_active_set', CLARABEL])
def test_the_limit_is_kept_however_far_the_goal(qp):
    """The goal, the edges and the obstacles are relaxed; what the motors give is not."""
    given = limited(settings(WALL, 51.0, ROAD), 10.0)
    given = replace(given, final_time=4.0, solver=replace(given.solver, qp=qp))
    horizon = remaining(0, PERIOD, to_nanoseconds(4.0))
    context = context_of(given, START, horizon, (8.0, 8.0))
    planner = Planner(OcpFormulation(given, given.world))
    result = planner.improve(context, context.center_line_guess, iterations=4)
    assert result.solved
    assert result.elastic
    commands = np.vstack([[8.0, 8.0], result.plan.controls[:-1]])
    assert np.abs(np.diff(commands, axis=0)).max() <= 2.0 + CHANGE_ROUNDING


@pytest.mark.parametrize(('away', 'stops_at_once'), [(0.6, True), (2.0, False)])
def test_after_a_late_command_it_brakes_only_where_that_is_clear(away, stops_at_once):
    given = limited(CASES['case 1'])
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, [k * PERIOD for k in range(12)])
    law.after_step(0.3)
    held = run.decisions[-2].wheel_speeds
    x, y, heading = run.pose
    place = x + away * np.cos(heading), y + away * np.sin(heading)
    reconfigure(law, replace(given, obstacles=(Obstacle('new', place, 0.3),)))
    decision = law.step(Observation(11 * PERIOD + PERIOD // 2, run.pose))
    assert np.any(decision.wheel_speeds) != stops_at_once
    if not stops_at_once:
        assert np.abs(decision.wheel_speeds - held).max() <= given.max_wheel_change


def test_slower_commands_for_late_ones_have_a_ramp_that_is_clear():
    given = limited(CASES['case 3'], max_command_delay=0.6)
    law, pose, slower = GuidanceLaw(given, given.world), np.array(START), 0
    for step in range(STEPS):
        decision = law.step(Observation(step * PERIOD, pose))
        slower += 'commands may be late' in decision.reason or 'if it is late' in decision.reason
        commands = np.vstack([decision.wheel_speeds, law._state.following.ramp])
        pieces = np.repeat(commands, 20, axis=0)
        path = given.robot.roll_out(pose, pieces, np.full(len(pieces), 0.01))
        assert clearance(path, given) >= -1e-3
        assert np.abs(np.diff(commands, axis=0)).max(initial=0.0) <= given.max_wheel_change + 1e-9
        assert not np.any(commands[-1])
        pose = path[20]
    assert slower > 0


@pytest.mark.parametrize('later', [15.0, 60.0])
def test_an_acceleration_that_changes_under_way_holds_from_the_next_command_on(later):
    given = limited(CASES['case 3'])
    law, changed = GuidanceLaw(given, given.world), limited(CASES['case 3'], later)

    def change(_run, stamp):
        if stamp == 20 * PERIOD:
            reconfigure(law, changed)

    run = drive(law, given, [k * PERIOD for k in range(STEPS + 20)], before=change)
    changes = np.abs(np.diff(run.controls, axis=0)).max(axis=1)
    assert changes[:19].max() <= given.max_wheel_change + CHANGE_ROUNDING
    assert changes[19:].max() <= changed.max_wheel_change + CHANGE_ROUNDING
    assert clearance(run.path, given) >= -1e-9
    assert not np.any(run.decisions[-1].twist)
