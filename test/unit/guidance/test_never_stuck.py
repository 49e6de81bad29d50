"""A robot that makes no progress tries other ways, backs out, turns, and stops with a reason."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from models import drive
from scenarios import MS
from seeing import Drive
from tight_places import CELL, TightRun, map_of, task

from cmpsp_ros.guidance import FallbackLevel, Goal, GuidanceLaw, Observation
from cmpsp_ros.guidance.commands.recovery import slow_moves
from cmpsp_ros.guidance.mission.progress_watch import ProgressWatch, Remedy, why_unreachable
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.times import Horizon
from cmpsp_ros.guidance.world import World
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.sensing import SightSettings
from cmpsp_ros.world.obstacles import Capsule
from cmpsp_ros.world.roads import OpenFloor

LIMITED = DifferentialDrive(max_wheel_speed=20.0, max_wheel_acceleration=50.0)


def test_a_gap_with_hardly_any_slack_is_passed():
    width = 0.366
    low, high = 3.2 - width / 2.0 - CELL, 3.2 + width / 2.0 + CELL
    walls = [
        Capsule(f'w{k}', (3.0, a), (3.0, b), CELL) for k, (a, b) in enumerate(((0, low), (high, 8)))
    ]
    given = task((6.0, 3.2), map_of(8, 8), *walls, robot=LIMITED)

    run = TightRun(given, (1.0, 3.2, 0.0), 60.0)

    # It passes the goal, and comes to rest.
    assert run.miss < 0.05
    assert run.clearance > 0.0


def one_door(width, **changes):
    walls = (3, 3.1, 0, 2), (3, 3.1, 2 + width, 4)
    return task((6.0, 2.15), map_of(8, 4, *walls), **({'final_time': 60.0} | changes))


@pytest.mark.parametrize(
    ('width', 'robot'), [(0.2, LIMITED), (0.3, DifferentialDrive(max_wheel_speed=20.0))]
)
def test_a_goal_behind_a_door_that_is_too_narrow_is_given_up_with_the_reason(width, robot):
    given = one_door(width, robot=robot)

    run = TightRun(given, (1.0, 2.15, 0.0), 40.0)
    last = run.decisions[-1]

    assert (last.finished, last.missed, last.level) == (True, True, FallbackLevel.STOP)
    assert run.time < 35.0
    assert 'The goal is unreachable: no plan gets past obstacle map at (3.' in last.reason
    assert last.time_left == 0.0
    assert run.clearance > 0.0
    assert any('turns on the spot' in each.reason for each in run.decisions)


def test_it_turns_by_half_a_turn_where_headings_are_wrapped():
    given = replace(one_door(0.3, robot=LIMITED), goal=(1.0, 2.15))
    law, pose, turning = GuidanceLaw(given, given.world), np.array([6.0, 2.15, 3.09]), []
    for k in range(60):
        wrapped = math.remainder(float(pose[2]), math.tau)
        decision = law.step(Observation(200 * k * MS, np.array([*pose[:2], wrapped])))
        law.after_step()
        if 'turns on the spot' in decision.reason:
            turning.append(float(pose[2]))
        pose = given.robot.roll_out(pose, decision.wheel_speeds[None], np.array([0.2]))[-1]
    assert abs(turning[-1] - turning[0]) > 0.9 * math.pi


def test_a_door_as_wide_as_the_robot_is_given_up_once():
    walls = (3, 3.1, 0, 2.75), (3, 3.1, 3.1, 4)
    given = task((6.0, 2.15), map_of(8, 4, *walls), final_time=60.0)

    run = TightRun(given, (1.0, 2.15, -2.0), 60.0)
    (searched,) = [each for each in run.decisions if 'another way than past' in each.reason]

    assert run.decisions[-1].finished
    place = re.search(r'past obstacle map at \(([\d.]+), ', run.decisions[-1].reason)
    assert 2.8 < float(place[1]) < 3.2
    # Another path through the same door is no progress.
    assert run.decisions[-1].stamp - searched.stamp < 15_000 * MS
    assert run.clearance > 0.0


def test_a_live_map_does_not_keep_it_from_giving_up():
    given, period = one_door(0.3, robot=LIMITED), np.array([0.2])
    law, pose, decision = GuidanceLaw(given, given.world), np.array([1.0, 2.15, 0.0]), None

    for step in range(175):
        if step % 5 == 4:
            # The same map, received again.
            given = replace(given, obstacles=one_door(0.3).obstacles)
            law.reconfigure(given, given.world)
        decision = law.step(Observation(step * 200 * MS, pose))
        law.after_step()
        if decision.finished:
            break
        pose = given.robot.roll_out(pose, decision.wheel_speeds[None], period)[-1]

    assert decision.finished
    assert 'no plan gets past obstacle map at (3.' in decision.reason


def test_a_wall_across_the_map_is_named():
    run = TightRun(task((6.0, 2.15), map_of(8, 4, (3, 3.1, 0, 4))), (1.0, 2.15, 0.0), 25.0)

    assert run.decisions[-1].finished
    assert 'no plan gets past obstacle map at (3.' in run.decisions[-1].reason
    assert 'which leaves 0.000 m beside the path' in run.decisions[-1].reason


@pytest.mark.slow
def test_a_gap_too_tight_at_the_speed_limit_is_given_up_with_a_remedy():
    # From one control instant to the next the path may stray four times as far.
    preset = 'parallel_parking', 'control_period=0.2'
    last, slow = (drive(*preset, *each)[1][-1] for each in ((), ('robot.max_wheel_speed=0.3',)))
    assert last.missed
    assert 'no moves to it were found among the obstacles' in last.reason
    assert (slow.finished, slow.missed) == (True, False)


def test_it_backs_out_along_its_trail():
    # In so short a time it sets out, and comes to the door.
    run = TightRun(one_door(0.3, final_time=20.0), (1.0, 2.15, 0.0), 40.0)

    backing = [each for each in run.decisions if 'backs out' in each.reason]
    assert sum(each.twist[0] < -0.1 for each in backing) > 5
    assert run.clearance > 0.0


@pytest.mark.parametrize(('width', 'may_fit'), [(0.35, True), (0.2, False)])
def test_the_reason_says_where_a_finer_grid_may_show_that_a_gap_fits(width, may_fit):
    given = task((6.0, 2.15), map_of(8, 4), sight=SightSettings(resolution=CELL))
    walls = map_of(8, 4, (3, 3.1, 0, 2), (3, 3.1, 2 + width, 4))
    start = PlanStart(np.array([1.0, 2.15, 0.0]), given.robot, given.world.seeing(walls.grid))

    reason = why_unreachable(given, start, (6.0, 2.15), ((3.05, 2.0 + width / 2.0),), '')

    assert 'no plan gets past obstacle seen at (3.' in reason
    assert ('a smaller sight.resolution may' in reason) == may_fit


def test_without_patience_it_waits_until_the_final_time():
    run = TightRun(one_door(0.3, patience=0.0), (1.0, 2.15, 0.0), 40.0)

    assert not any('no progress' in each.reason for each in run.decisions)
    assert not run.decisions[-1].finished


def test_a_goal_is_not_given_up_for_lack_of_computing_time():
    given = one_door(0.3)
    law, pose, decision = GuidanceLaw(given, given.world), np.array([1.0, 2.15, 0.0]), None
    for step in range(200):
        decision = law.step(Observation(step * 200 * MS, pose))
        decision = law.after_step(0.25 if step % 3 == 1 else 0.0)
        assert not decision.finished, decision.reason
        held = decision.wheel_speeds[None]
        pose = given.robot.roll_out(pose, held, np.array([given.control_period]))[-1]


def test_a_goal_that_comes_after_one_was_given_up_is_driven_to():
    given = one_door(0.3, hold=True)
    law, pose, decision, stamp = (
        GuidanceLaw(given, given.world),
        np.array([1.0, 2.15, 0.0]),
        None,
        0,
    )

    def drive(until):
        nonlocal pose, decision, stamp
        while stamp < until and not (decision is not None and decision.finished):
            decision = law.step(Observation(stamp, pose))
            law.after_step()
            held = decision.wheel_speeds[None]
            pose = given.robot.roll_out(pose, held, np.array([given.control_period]))[-1]
            stamp += 200 * MS

    drive(40_000 * MS)
    assert 'unreachable' in decision.reason
    # It does not set out again by itself, though it holds its goals.
    decision = law.step(Observation(stamp, pose))
    assert decision.finished
    law.set_goal(0, Goal((1.0, 1.0), 0.0))
    stamp, decision = stamp + 200 * MS, None
    drive(stamp + 40_000 * MS)

    assert math.dist(pose[:2], (1.0, 1.0)) < given.goal_tolerance
    assert not decision.missed


@pytest.mark.parametrize('received', [False, True])
def test_a_goal_that_was_given_up_stays_so_while_nothing_has_changed(received):
    given, pose, stamp = one_door(0.3, robot=LIMITED), np.array([1.0, 2.15, 0.0]), 0
    law, decision = GuidanceLaw(given, given.world), None
    if received:
        law.set_goal(0, Goal(given.goal, 60.0))

    def drive():
        nonlocal pose, stamp, decision
        decision = law.step(Observation(stamp, pose))
        law.after_step()
        held = decision.wheel_speeds[None]
        pose, stamp = given.robot.roll_out(pose, held, np.array([0.2]))[-1], stamp + 200 * MS

    while decision is None or not decision.finished:
        drive()
    reason = decision.reason
    assert 'The goal is unreachable' in reason
    # The same map once more, and another parameter.
    same = replace(given, obstacles=one_door(0.3).obstacles)
    for settings in same, replace(same, hold=True):
        law.reconfigure(settings, settings.world)
        drive()
        assert (decision.finished, decision.reason) == (True, reason)
        assert not decision.twist.any()
    # A map with a wider door.
    wider = replace(given, obstacles=one_door(1.0).obstacles)
    law.reconfigure(wider, wider.world)
    drive()
    assert decision.finished == received


def test_new_ground_and_a_shorter_way_are_progress_and_circles_are_not():
    watch = ProgressWatch()
    watch.count(np.array([0.0, 0.0, 0.0]), 10.0)
    assert watch.steps == 0
    for _ in range(5):
        watch.count(np.array([0.1, 0.1, 0.0]), 9.99)
    assert watch.steps == 5
    watch.count(np.array([0.1, 0.1, 0.0]), 9.9)
    assert watch.steps == 0
    # To a robot that stands a way that becomes shorter, as more is seen, is none.
    for k in range(5):
        watch.count(np.array([0.11, 0.09, 0.0]), 9.8 - 0.1 * k)
    assert watch.steps == 5
    watch.count(np.array([0.2, 0.1, 0.0]), 9.3)
    assert watch.steps == 0
    for k in range(200):
        angle = 0.1 * k
        watch.count(np.array([math.cos(angle), math.sin(angle), angle]), 20.0)
    assert watch.steps > 100
    # A plan that reaches the goal is no progress until it is driven.
    steps = watch.steps
    watch.count(np.array([1.0, 0.0, 0.0]), 20.0, is_excused=True)
    assert watch.steps == steps
    # Where no way leads new ground is none.
    watch.reset()
    watch.count(np.array([50.0, 0.0, 0.0]), math.inf)
    assert (watch.steps, watch.remedy) == (1, Remedy.NONE)


def box(left, right, low, high):
    return [left, low, right, low, right, high, left, high]


def seen(goal, final_time, **boxes):
    """Changes of a preset: boxes on open floor that only a scanner of 270 degrees sees."""
    changes = {
        'road.type': 'none',
        'goal.may_be_late': True,
        'goal.position': goal,
        'goal.tolerance': 0.05,
        'final_time': final_time,
        'robot.max_wheel_speed': 28.0,
        'sim.scan.angle_min': -0.75 * math.pi,
        'sim.scan.angle_max': 0.75 * math.pi,
        'sim.scan.count': 541,
        'sight.memory': 600.0,
        'sim.obstacles.names': list(boxes),
    }
    for name, vertices in boxes.items():
        changes[f'sim.obstacles.{name}.type'] = 'polygon'
        changes[f'sim.obstacles.{name}.vertices'] = vertices
    return changes


def test_a_goal_shut_off_by_what_only_the_scanner_sees():
    longest, crate = 40.0, box(4.4, 5.6, -0.6, 0.6)
    run = Drive(end=longest + 5.0, **seen([5.0, 0.0], 8.0, crate=crate))
    last = next(each for each in run.decisions if each.finished)
    assert last.missed
    assert 'The goal is unreachable: no plan gets past obstacle seen at' in last.reason
    assert last.stamp < 1e9 * longest
    assert run.clearance > 0.0


@pytest.mark.parametrize('robot', ['case1', 'omni_aisle', 'parking'])
def test_moves_away_from_what_is_near_are_slow_and_end_farther_from_it(robot):
    given = guidance_settings(TABLE.resolve(load_parameter_file(robot)))
    beside = given.circumscribed_radius + 0.05
    wall = Capsule('wall', (-1.0, beside), (1.0, beside), 0.01)
    world = World(OpenFloor(), (wall,))
    horizon = Horizon.between([k * round(given.control_period * 1e9) for k in range(41)])

    moves = slow_moves(PlanningContext.at_pose(given, world, np.zeros(3), horizon))

    assert len(moves) >= 2
    ends = [world.free_space(given).at(each.poses).min(axis=1) for each in moves]
    assert ends == sorted(ends, key=lambda away: -away[-1])
    for each, away in zip(moves, ends, strict=True):
        steps = np.hypot(*np.diff(each.poses[:, :2], axis=0).T) / each.horizon.durations
        assert steps.max() <= 0.1 + 1e-9
        assert steps[-1] == 0.0
        assert away[-1] > away[0]
        assert away.min() >= min(away[0], 0.0) - 1e-3
