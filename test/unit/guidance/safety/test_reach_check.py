"""Speeds of a robot that somebody could reach before it is at rest."""

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceSettings, MovingObstacles, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.prediction.estimator import Estimator
from cmpsp_ros.guidance.safety.reach_check import ReachCheck
from cmpsp_ros.guidance.world import World
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.roads import OpenFloor

ROBOT = DifferentialDrive(wheel_radius=0.0357, half_track=0.1165, max_wheel_speed=8.5)
SETTINGS = GuidanceSettings(
    robot=ROBOT,
    road=OpenFloor(),
    goal=(5.0, 0.0),
    final_time=30.0,
    robot_radius=0.175,
    moving_obstacles=MovingObstacles(capacity=8),
)
LOST, IN_SIGHT = 0.4, 0.02


def start_beside(number, place, velocity, stddev):
    """Start of a plan with one person about."""
    person = Track(number, 0, 0.25, *place, *velocity, stddev, 0.3)
    seen = Observation(0, np.zeros(3), (person,))
    return Estimator(SETTINGS).update(seen, World(OpenFloor()), ROBOT.at_rest).start


def reason(speed, *person):
    """Why the robot may not drive straight at a speed, with one person in sight or lost."""
    start = start_beside(Track.SEEN + 1, *person)
    controls = ROBOT.controls(np.array([speed, 0.0]))[None]
    check = ReachCheck(SETTINGS, SETTINGS.robot_radius)
    return check.reason(start, controls, np.array([0.5]))


@pytest.mark.parametrize('distance', [1.5, 1.7])
def test_a_robot_drives_away_from_where_somebody_was_lost_sight_of(distance):
    behind, leaving = (-distance, 0.0), (-0.5, 0.0)
    assert reason(0.3, behind, leaving, LOST) == ''
    assert 'person 1 could be' in reason(-0.3, behind, leaving, LOST)


@pytest.mark.parametrize('stddev', [IN_SIGHT, LOST])
def test_who_comes_at_it_is_waited_for(stddev):
    behind, coming = (-0.5, 0.0), (0.8, 0.0)
    assert 'person 1 could be' in reason(0.3, behind, coming, stddev)


def test_whom_it_touches_or_has_just_left_it_does_not_leave_at_speed():
    assert 'touches the robot' in reason(0.3, (-0.4, 0.0), (0.0, 0.0), LOST)
    assert 'person 1 could be' in reason(0.3, (-1.0, 0.0), (0.0, 0.0), LOST)


@pytest.mark.parametrize(
    ('number', 'stddev', 'planned'),
    [(Track.SEEN + 1, 0.1, 0.16), (Track.SEEN + 1, 1.0, 0.2), (1, 1.0, 1.06)],
    ids=['in sight', 'out of sight', 'told'],
)
def test_who_is_out_of_sight_does_not_fill_the_room_of_plans(number, stddev, planned):
    start = start_beside(number, (2.0, 0.0), (0.0, 0.5), stddev)
    assert start.moving.states[0, 4] == pytest.approx(0.25 + 2.0 * planned)
    assert start.reachable.states[0, 4] == pytest.approx(0.25 + 3.0 * stddev)
