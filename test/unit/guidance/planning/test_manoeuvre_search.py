"""Moves into tight places: clear, driven exactly by their guess, and found by bounded work."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import start_of
from tight_places import task

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.planning.homotopy.path_search import searched_paths
from cmpsp_ros.guidance.planning.manoeuvre_search import ManoeuvreSearch, needs_manoeuvres, timed
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety.unseen import drives_blind
from cmpsp_ros.guidance.times import Horizon
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.robots import DifferentialDrive, covered, placed
from cmpsp_ros.studies.monte_carlo.driving import drive, outcome
from cmpsp_ros.studies.monte_carlo.study import Study
from cmpsp_ros.world.grids import Cell, OccupancyGrid
from cmpsp_ros.world.obstacles import Capsule

# A base with corners that does not fit across its bay.
BAY = {
    'robot.model': 'differential_drive',
    'robot.wheel_radius': 0.03575,
    'robot.half_track': 0.1165,
    'robot.max_wheel_speed': 6.0,
    'robot.max_wheel_acceleration': 0.0,
    'robot.max_steering_rate': 0.0,
    'robot.joint_names': ['right', 'left'],
    'robot.footprint': '[[0.25, 0.17], [0.25, -0.17], [-0.25, -0.17], [-0.25, 0.17]]',
    'obstacles.rear_car.vertices': [1.3, -1.0, 2.0, -1.0, 2.0, -0.3, 1.3, -0.3],
    'obstacles.front_car.vertices': [2.46, -1.0, 3.2, -1.0, 3.2, -0.3, 2.46, -0.3],
    'goal.position': [2.23, -0.7],
    'goal.heading': [math.pi / 2.0],
    'initial_pose': [1.4, 0.2, 0.0],
}
# The gap is closed by a wall along the parked cars.
CLOSED = {'obstacles.street.vertices': [0.8, -0.56, 4.0, -0.56, 4.0, -0.5, 0.8, -0.5]}


def search_for(**changes):
    values = TABLE.resolve({**load_parameter_file('parallel_parking'), **changes})
    settings = guidance_settings(values)
    pose, rest = np.array(values['initial_pose']), settings.robot.at_rest
    start = PlanStart(pose, settings.robot, settings.world, previous_control=rest)
    assert needs_manoeuvres(settings, start, settings.target)
    search = ManoeuvreSearch(settings, start, settings.target)
    for _ in range(400):
        if search.is_over:
            return settings, start, search
        search.advance()
    raise AssertionError('the search does not end')


def corners_clear(settings, pose):
    """Distance of the robot's outline from convex obstacles, by points and separating axes."""
    outline = placed(np.array(settings.footprint.outline[0]), pose)
    least = math.inf
    for obstacle in settings.obstacles:
        corners = np.array(obstacle.corners)
        along = np.roll(corners, -1, axis=0) - corners
        normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.hypot(*along.T)[:, None]
        away = np.einsum('kcj,cj->kc', outline[:, None] - corners, normals).max(axis=1)
        least = min(least, float(away.min()))
    return least


@pytest.mark.parametrize('changes', [{}, BAY], ids=['car', 'base'])
def test_the_moves_lead_to_the_goal_and_touch_nothing(changes):
    settings, start, search = search_for(**changes)
    durations = np.full(400, settings.control_period)
    controls = timed(settings, start, durations, search.path)
    assert controls.shape == (401, 2)
    robot = settings.robot
    limits = settings.max_wheel_change, robot.rate_limits
    changes = np.abs(np.diff(controls, axis=0, prepend=robot.at_rest[None]) @ limits[1].T)
    assert changes.max() <= limits[0] * (1.0 + 1e-9)
    assert (np.abs(controls) <= robot.bounds * (1.0 + 1e-12)).all()
    poses = robot.roll_out(start.pose, controls[:-1], durations)
    assert settings.target.errors(poses[-1]) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert min(corners_clear(settings, each) for each in poses) > settings.safety.margin


def test_without_a_way_the_search_ends_with_none():
    _, start, search = search_for(initial_pose=[1.6, -0.2, 0.0], **CLOSED)
    assert search.path == ()
    assert search.is_for(start, search.target)


def test_the_work_of_a_call_is_bounded():
    settings, start, _ = search_for()
    search, before = ManoeuvreSearch(settings, start, settings.target), 0
    while not search.is_over:
        search.advance()
        done = int(search._tree.counts[2])
        assert done - before <= 96
        before = done


def test_too_little_time_gives_no_guess():
    settings, start, search = search_for()
    assert timed(settings, start, np.full(30, settings.control_period), search.path) is None


def test_a_clear_path_of_the_usual_kind_needs_no_search():
    values = TABLE.resolve(load_parameter_file('parking'))
    settings = guidance_settings(values)
    start = PlanStart(np.array(values['initial_pose']), settings.robot, settings.world)
    assert not needs_manoeuvres(settings, start, settings.target)


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
def test_fields_of_cylinders_that_leave_hardly_a_way_are_passed():
    """In the narrowest, last bits decide whether the noise of odometry leaves a clear move."""
    study = Study('clutter', seed=21, assignments=('goal.when=soonest',))
    found = [outcome(drive(study.run(number))) for number in range(388, 398)]

    assert sum(each.miss < 0.1 for each in found) >= 9
    assert min(each.obstacle_clearance for each in found) > 0.02
