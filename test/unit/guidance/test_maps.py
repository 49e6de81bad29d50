"""The law on maps: it arrives, clear of every occupied square, and decides the same again."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scenarios import MS, drive

from cmpsp_ros.guidance import (
    FallbackLevel,
    Goal,
    GuidanceLaw,
    GuidanceSettings,
    InitialGuess,
    Observation,
    Safety,
)
from cmpsp_ros.guidance.formulation import N_EDGE_CONSTRAINTS
from cmpsp_ros.guidance.mission import infeasibility_warnings
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety import Validator
from cmpsp_ros.mpsp.jit import compilations
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid
from cmpsp_ros.world.roads import OpenFloor

PRESETS = ('warehouse', 'door', 'dead_end')
CELL = 0.05


def distance_to_squares(grid, path):
    """Least distance of points from the occupied squares of a grid at the origin."""
    rows, columns = np.nonzero(grid.cells != Cell.FREE)
    least = math.inf
    for x, y in path[:, :2]:
        across = np.maximum(np.abs(x / grid.resolution - columns - 0.5) - 0.5, 0.0)
        along = np.maximum(np.abs(y / grid.resolution - rows - 0.5) - 0.5, 0.0)
        least = min(least, float(np.hypot(across, along).min()) * grid.resolution)
    return least


@cache
def driven(name):
    values = TABLE.resolve(load_parameter_file(name))
    settings = guidance_settings(values)
    period = round(settings.control_period * 1000) * MS
    stamps = [k * period for k in range(round(settings.final_time * 1e9) // period + 1)]
    return settings, drive(
        GuidanceLaw(settings, settings.world), settings, stamps, values['initial_pose'], 8
    )


@pytest.mark.parametrize('name', PRESETS)
def test_presets_arrive_clear_of_every_square(name):
    settings, run = driven(name)
    (grid,) = (each.grid for each in settings.obstacles)

    assert run.miss(settings.goal) < settings.goal_tolerance
    assert distance_to_squares(grid, run.path) >= settings.robot_radius
    assert {each.level for each in run.moves} == {FallbackLevel.NOMINAL}
    least = min(each.clearance for each in run.moves)
    assert 0.0 <= least <= distance_to_squares(grid, run.path) - settings.robot_radius + 1e-6


@pytest.mark.parametrize('name', PRESETS)
def test_decisions_are_the_same_again_and_nothing_is_compiled_on_the_way(name):
    run = driven(name)[1]
    with compilations() as compiled:
        again = driven.__wrapped__(name)[1]
    assert not compiled
    np.testing.assert_array_equal(run.controls, again.controls)
    assert [each.reason for each in run.decisions] == [each.reason for each in again.decisions]


def course(*boxes, size=(80, 120), **changes):
    """Open floor with a map; boxes are rows and columns of what is occupied."""
    cells = np.zeros(size, np.uint8)
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = Cell.OCCUPIED
    for top, bottom, left, right in boxes:
        cells[top:bottom, left:right] = Cell.OCCUPIED
    given = GuidanceSettings(
        robot=DifferentialDrive(max_wheel_speed=20.0),
        road=OpenFloor(),
        goal=(5.0, 2.0),
        obstacles=(GridObstacle('map', OccupancyGrid((0.0, 0.0, 0.0), CELL, cells)),),
        robot_radius=0.2,
        safety=Safety(0.02),
        initial_guess=InitialGuess('road'),
        final_time=12.0,
    )
    return replace(given, **changes)


WALL = (0, 60, 58, 60)


def test_the_audit_refuses_to_drive_into_the_map_and_names_it():
    given, pose = course(WALL), np.array([2.6, 2.0, 0.0])
    validator, start = Validator(given), PlanStart(pose, given.robot, given.world)
    straight = np.full((3, 2), 20.0)

    verdict = validator.check(start, straight, np.full(2, 0.2))

    assert not verdict.passed
    assert 'too close to obstacle map' in verdict.reason
    away = validator.check(start, -straight, np.full(2, 0.2))
    assert away.passed
    assert away.nearest == 'obstacle map'
    assert validator.clearance_at(given.world, pose)[N_EDGE_CONSTRAINTS] == pytest.approx(
        0.3 - 0.2, abs=5e-3
    )
    assert 'inside obstacle map' in validator.why_no_start(given.world, np.array([2.8, 2.0, 0.0]))


def test_homotopy_classes_are_told_by_what_stands_alone_on_the_map():
    given = course((36, 46, 56, 64))

    decision = GuidanceLaw(given, given.world).step(Observation(0, np.array([1.0, 2.0, 0.0])))

    assert 'the best of 2 plans' in decision.reason
    assert 'of the map at (3.0, 2.' in decision.reason


def test_a_map_without_a_way_is_foretold_and_nothing_is_touched():
    given = course((0, 80, 58, 60))

    (said,) = infeasibility_warnings(given, given.world, (1.0, 2.0))
    run = drive(
        GuidanceLaw(given, given.world),
        given,
        [k * 200 * MS for k in range(61)],
        (1.0, 2.0, 0.0),
        8,
    )

    assert said.startswith('The map leaves no way from (1, 2) m to the goal')
    assert infeasibility_warnings(given, course(WALL).world, (1.0, 2.0)) == []
    assert distance_to_squares(given.obstacles[0].grid, run.path) >= given.robot_radius
    assert run.decisions[-1].missed


def test_a_goal_that_is_received_is_given_the_time_of_the_way_around():
    given = course(WALL)
    law = GuidanceLaw(given, given.world)
    pose = np.array([1.0, 2.0, 0.0])
    law.step(Observation(0, pose))

    law.set_goal(0, Goal((5.0, 1.0), 0.0))
    decision = law.step(Observation(200 * MS, pose))

    straight = 4.2 / given.pace
    assert straight * 1.3 < decision.time_left < straight * 3.0


def random_map(random):
    """Boxes, walls and pillars in a room of 10 m by 8 m."""
    boxes = []
    for _ in range(random.integers(8, 25)):
        row, column = int(random.integers(0, 155)), int(random.integers(0, 195))
        high, wide = random.choice([(3, 50), (50, 3), (12, 12), (8, 14)])
        boxes.append((row, row + int(high), column, column + int(wide)))
    return course(*boxes, size=(160, 200), robot_radius=0.175)


def way_on(given, random):
    """A start and a goal with a way between them that plans may keep to, and its length [m]."""
    search = given.world.map_search(given)
    validator = Validator(given).with_margin(given.safety.margin)
    while True:
        start, goal = random.uniform([0.5, 0.5], [9.5, 7.5], (2, 2))
        line = search.line(start, tuple(goal.tolist()), 0.1)
        clear = len(line) and min(
            validator.clearance_at(given.world, np.array([*each, 0.0])).min() for each in line
        )
        if clear > search.wanted - given.kept and math.dist(start, goal) > 4.0:
            return start, tuple(goal.tolist()), float(np.hypot(*np.diff(line, axis=0).T).sum())


@pytest.mark.slow
@pytest.mark.parametrize('seed', range(10))
def test_random_maps_are_crossed(seed):
    random = np.random.default_rng(seed)
    given = random_map(random)
    start, goal, length = way_on(given, random)
    # A third more than at full speed, and a turn at first.
    steps = math.ceil((1.33 * length / given.robot.max_speed + 4.0) / given.control_period)
    given = replace(given, goal=goal, final_time=steps * given.control_period)
    stamps = [k * 200 * MS for k in range(steps + 1)]

    run = drive(GuidanceLaw(given, given.world), given, stamps, (*start, random.uniform(-3, 3)), 8)

    assert run.miss(goal) < given.goal_tolerance
    assert distance_to_squares(given.obstacles[0].grid, run.path) >= given.robot_radius
