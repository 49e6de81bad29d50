"""Moves into tight places: clear, driven exactly by their guess, and found by bounded work."""

import math

import numpy as np
import pytest

from cmpsp_ros.guidance.planning.manoeuvre_search import ManoeuvreSearch, needs_manoeuvres, timed
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.robots import placed

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


def test_the_search_finds_the_same_moves_again():
    assert search_for()[2].path == search_for()[2].path


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
