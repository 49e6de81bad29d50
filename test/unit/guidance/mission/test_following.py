"""A road followed without end: steady speed, nothing touched, nothing that grows."""

import gc
import math
import os
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scenarios import PERIOD, law_of
from scenarios import drive as drive_law
from seeing import Drive

from cmpsp_ros.bags.runs import mean_speed
from cmpsp_ros.guidance import (
    FallbackLevel,
    Follow,
    Goal,
    GoalError,
    GuidanceLaw,
    GuidanceSettings,
    Observation,
)
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file, plant_settings
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import Plant
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus, arc_length_to, lookahead_point

MINUTES = float(os.environ.get('ENDLESS_MINUTES', '1.5'))
"""Simulated time: two rounds; `ENDLESS_MINUTES=60 pytest -s ...` makes an hour of it."""

GROWTH = 50_000
"""Memory that may be held at the end more than after the second tenth [bytes]."""


@pytest.mark.timeout(120 if MINUTES < 2.0 else 600 * MINUTES)
def test_rounds_are_alike_under_noise():
    noise = {'noise.position_stddev': 0.003, 'noise.heading_stddev': 0.003, 'odom_rate': 5.0}
    values = TABLE.resolve(load_parameter_file('endless') | {'final_time': 0.0} | noise)
    given, plant, stamp = guidance_settings(values), Plant(plant_settings(values)), 0
    law = GuidanceLaw(given, given.world)
    space = FreeSpace.of(given.road, given.obstacles, given.robot_radius)
    steps, memory = round(MINUTES * 60.0 / given.control_period / 10), []
    durations = np.full(steps, given.control_period)
    tracemalloc.start()
    for _ in range(10):
        poses, twists = [plant.pose], []
        for _ in range(steps):
            decision = law.step(Observation(stamp, plant.measure()))
            assert decision.level is FallbackLevel.NOMINAL
            plant.command(stamp, *decision.twist.tolist())
            plant.advance(stamp := stamp + PERIOD)
            poses.append(plant.pose)
            twists.append(decision.twist)
        path = np.array(poses)
        clearance = space.along(path[:-1], np.array(twists), durations).min()
        speed = mean_speed(given, path, float(durations.sum()))
        gc.collect()
        memory.append(tracemalloc.get_traced_memory()[0])
        print(f'{stamp / 60e9:.1f} min: {speed:.5f} m/s, {clearance:+.4f} m, {memory[-1]} bytes')
        assert speed == pytest.approx(1.2, rel=0.01)
        assert clearance >= 0.0
    tracemalloc.stop()
    assert memory[-1] - memory[1] < GROWTH


def settings(speed, **changes):
    robot = DifferentialDrive(max_wheel_speed=51.0)
    follow = Follow(speed, 5.0)
    return GuidanceSettings(
        robot, (10.0, 0.0), road=Annulus(), final_time=math.inf, follow=follow, **changes
    )


@pytest.mark.parametrize('speed', [1.2, -1.2])
def test_a_ring_is_followed_in_either_direction(speed):
    given = settings(speed, obstacles=(Obstacle('a', (10.0, 0.3), 0.4),))
    start = (0.0, -10.2, 0.0 if speed > 0.0 else math.pi)
    law, steps = GuidanceLaw(given, given.world), 400
    run = drive_law(law, given, [k * PERIOD for k in range(steps + 1)], start)
    assert {decision.level for decision in run.decisions} == {FallbackLevel.NOMINAL}
    assert all(math.isinf(decision.time_left) for decision in run.decisions)
    assert all(decision.goal is None for decision in run.decisions)
    bearing = np.unwrap(np.arctan2(run.path[:, 1], run.path[:, 0]))
    turned = (bearing[-1] - bearing[0]) * 10.0 / (steps * 0.2)
    assert turned == pytest.approx(speed, rel=0.01)
    assert np.linalg.norm(run.path[:, :2] - (10.0, 0.3), axis=1).min() >= 0.4 - 1e-9
    # What is reached ahead is a line across the road: beside it no place is asked for.
    assert np.median([decision.terminal_error for decision in run.decisions]) < 1e-3


def test_it_ends_at_the_final_time_where_there_is_one():
    given = replace(settings(1.2), final_time=1.0)
    law, start = GuidanceLaw(given, given.world), (0.0, -10.0, 0.0)
    run = drive_law(law, given, [k * PERIOD for k in range(7)], start)
    assert [decision.finished for decision in run.decisions] == [False] * 5 + [True] * 2
    assert not run.decisions[-1].missed
    assert run.decisions[0].time_left == 1.0


def test_no_goal_is_taken():
    law = law_of(settings(1.2))
    with pytest.raises(GoalError, match='follows the road'):
        law.set_goal(0, Goal((10.0, 0.0), 0.0))


def test_a_line_ahead_is_on_the_centre_line_in_the_direction_driven():
    pose = np.array([9.5, 0.0, math.pi / 2.0])
    for way in (5.0, -5.0):
        (x, y), direction = lookahead_point(Annulus(), pose, way)
        assert math.hypot(x, y) == pytest.approx(10.0)
        assert math.atan2(y, x) == pytest.approx(way / 10.0)
        assert math.cos(direction - way / 10.0) == pytest.approx(0.0, abs=1e-9)
        assert math.sin(direction - way / 10.0) == pytest.approx(math.copysign(1.0, way))
        assert arc_length_to(Annulus(), pose, (x, y)) == pytest.approx(way)


def test_a_robot_that_is_stuck_tries_the_remedies_again_and_again():
    given = settings(1.2, robot_radius=0.2)
    law, pose = GuidanceLaw(given, given.world), np.array([0.0, -9.05, 0.0])

    decisions = []
    for step in range(100):
        decisions.append(law.step(Observation(step * 200_000_000, pose)))
        law.after_step()

    reasons = [each.reason for each in decisions]
    first = [k for k, each in enumerate(reasons) if 'There was no progress' in each]
    assert first[0] == 16
    assert len(first) > 1
    assert any('turns on the spot' in each for each in reasons[first[0] : first[1]])
    assert not any(each.finished for each in decisions)


def test_a_car_that_sees_drives_no_faster_than_asked():
    angles = np.linspace(0.0, math.tau, 16, endpoint=False)
    oval = np.column_stack([9.0 * np.cos(angles), 6.0 * np.sin(angles)])
    changes = {
        'control_period': 0.1,
        'follow.speed': 2.0,
        'follow.horizon': 3.0,
        'initial_pose': [9.0, 0.0, math.pi / 2.0],
        'robot.joint_names': ['rear_axle'],
        'robot.max_steering_angle': 0.42,
        'robot.max_steering_rate': 3.2,
        'robot.max_wheel_acceleration': 2.5,
        'robot.max_wheel_speed': 5.0,
        'robot.model': 'ackermann',
        'robot.wheel_base': 0.33,
        'robot.wheel_radius': 1.0,
        'road.closed': True,
        'road.half_width': [1.15],
        'road.points': oval.ravel().tolist(),
        'sim.obstacles.names': [],
    }

    speeds = [each.twist[0] for each in Drive(end=6.0, **changes).decisions]

    assert max(speeds) < 2.1
    assert np.mean(speeds[20:]) == pytest.approx(2.0, rel=0.02)
