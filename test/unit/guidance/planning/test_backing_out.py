"""A robot that cannot turn where it is backs out, and drives nowhere blindly."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import start_of
from tight_places import task

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.planning.homotopy.path_search import searched_paths
from cmpsp_ros.guidance.safety.unseen import drives_blind
from cmpsp_ros.guidance.times import Horizon
from cmpsp_ros.robots import DifferentialDrive, covered
from cmpsp_ros.studies.monte_carlo.driving import drive, outcome
from cmpsp_ros.studies.monte_carlo.study import Study
from cmpsp_ros.world.grids import Cell, OccupancyGrid
from cmpsp_ros.world.obstacles import Capsule

DURATIONS = np.full(60, 0.2)
BODY, RADIUS = covered(((0.25, 0.2), (-0.25, 0.2), (-0.25, -0.2), (0.25, -0.2)))
LIMITED = DifferentialDrive(max_wheel_speed=20.0, max_wheel_acceleration=50.0)
SHAPED = {'robot': LIMITED, 'footprint': BODY, 'robot_radius': RADIUS}
LANE = tuple(Capsule(f'w{k}', (-2.0, y), (1.0, y), 0.05) for k, y in enumerate((0.35, -0.35)))


def way_back(heading):
    """The searched path from a lane that is too narrow to turn in, and where its guess leads."""
    given = task((-4.0, 0.0), *LANE, **SHAPED)
    start = start_of(given, (0.2, 0.0, heading))
    space = given.world.free_space(given, given.safety.margin)
    (path,) = searched_paths(given, space, start, given.target, DURATIONS)
    return path, given.robot.roll_out(start.pose, path.guess, DURATIONS), space


def test_a_guess_backs_out_until_the_robot_can_turn_and_goes_on_ahead():
    path, poses, space = way_back(0.0)

    assert path.backward == pytest.approx(2.7, abs=0.2)
    assert space.at(poses).min() > 0.0
    outside = poses[poses[:, 0] < -2.7]
    assert abs(math.remainder(outside[-1, 2] - math.pi, math.tau)) < 0.3
    assert math.dist(poses[-1, :2], (-4.0, 0.0)) < 0.3


def test_a_way_that_leads_ahead_is_driven_ahead():
    path, poses, _ = way_back(math.pi)

    assert path.backward is None
    assert np.ptp(poses[:, 2]) < 0.4


def test_backward_to_where_nothing_was_seen_is_blind():
    given = task((-4.0, 0.0), **SHAPED)
    cells = np.zeros((80, 80), np.uint8)
    cells[:, :20] = Cell.UNKNOWN
    world = given.world.seeing(OccupancyGrid((-2.0, -2.0, 0.0), 0.05, cells))

    def is_blind(pose, wheels, seconds):
        durations = np.full(seconds * 5, 0.2)
        edges = np.concatenate([[0], np.cumsum(np.full(len(durations), 200_000_000))])
        controls = np.full((len(edges), 2), wheels)
        start = start_of(given, pose)._replace(world=world)
        poses = given.robot.roll_out(start.pose, controls, durations)
        return drives_blind(given, Plan(Horizon(edges, durations), controls, poses), start)

    assert is_blind((0.5, 0.0, 0.0), -10.0, 4)
    assert not is_blind((0.5, 0.0, 0.0), -10.0, 1)
    assert not is_blind((0.5, 0.0, math.pi), 10.0, 4)


@pytest.mark.slow
def test_a_field_with_a_dead_end_costs_no_more_than_twice_the_time():
    task = replace(Study('clutter', assignments=('goal.when=soonest',)).run(29), patience=30.0)
    driven = drive(task)
    found = outcome(driven)

    assert found.miss < 0.1
    assert found.obstacle_clearance > 0.02
    assert found.slowness < 2.0


@pytest.mark.slow
def test_a_robot_wedged_among_cylinders_edges_away_and_arrives():
    driven = drive(Study('clutter', seed=21, assignments=('goal.when=soonest',)).run(394))

    assert any('edges away from what is near' in each.reason for each in driven.decisions)
    assert outcome(driven).miss < 0.1
    assert outcome(driven).obstacle_clearance > 0.02
