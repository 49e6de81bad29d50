"""Among people, what is small and stands alone may be somebody who sets off."""

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceSettings, MovingObstacles, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.prediction.bystanders import bystanders
from cmpsp_ros.guidance.prediction.estimator import Estimator
from cmpsp_ros.guidance.safety.reach_check import ReachCheck
from cmpsp_ros.guidance.world import World
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.grids import Cell, OccupancyGrid
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import OpenFloor

SECOND = 1_000_000_000
CELL = 0.05
ROBOT = DifferentialDrive(
    wheel_radius=0.1, half_track=0.2, max_wheel_speed=20.0, max_wheel_acceleration=20.0
)
SETTINGS = GuidanceSettings(
    robot=ROBOT,
    road=OpenFloor(),
    goal=(5.0, 0.0),
    final_time=10.0,
    robot_radius=0.3,
    moving_obstacles=MovingObstacles(capacity=8),
)
WORLD = World(OpenFloor())
HERE = np.zeros(3)
FAR_AWAY = Track(Track.SEEN + 1, 0, 0.25, 3.0, 8.0, 0.0, 1.0, 0.02, 0.1)


def sighting(*boxes):
    """A grid of free cells around the origin with boxes (x, y, width, depth) [m] in it."""
    cells = np.zeros((200, 200), np.uint8)
    grid = OccupancyGrid((-5.0, -5.0, 0.0), CELL, cells)
    for x, y, width, depth in boxes:
        (low, left), (high, right) = (
            [int(each) for each in grid.indices(np.array(corner))]
            for corner in ((x, y), (x + width, y + depth))
        )
        cells[low:high, left:right] = Cell.OCCUPIED
    return Sighting(0, grid)


PERSON = (0.975, 0.775, 0.5, 0.3)


def test_a_small_thing_that_stands_alone_is_one_disc_behind_its_front():
    (found,) = bystanders(SECOND, HERE, sighting(PERSON), WORLD, 0.8)
    front = np.hypot(0.975, 0.775) - CELL / 2.0
    assert (found.vx, found.vy, found.name) == (0.0, 0.0, 'somebody standing')
    assert found.radius == pytest.approx(0.25)
    walked = 0.8 * (1e-9 * (SECOND - found.stamp)) ** 2 / 2.0
    assert walked == pytest.approx(CELL)
    assert np.hypot(found.x, found.y) - found.radius == pytest.approx(front)
    assert found.y / found.x == pytest.approx(0.8, abs=0.05)


def test_both_legs_are_found():
    legs = sighting((1.0, 0.5, 0.15, 0.1), (1.0, 0.8, 0.15, 0.1))
    assert len(bystanders(0, HERE, legs, WORLD, 0.8)) == 2


@pytest.mark.parametrize(
    'box',
    [(1.0, 0.8, 1.0, 0.1), (1.0, 0.8, 0.05, 0.05), (2.4, 0.0, 0.3, 0.3), (3.5, 0.0, 0.3, 0.3)],
    ids=['wall', 'single cell', 'cut by the edge of what matters', 'far away'],
)
def test_nothing_else_is_a_bystander(box):
    assert bystanders(0, HERE, sighting(box), WORLD, 0.8) == ()


def test_a_known_pillar_is_nobody():
    world = World(OpenFloor(), (Obstacle('pillar', (1.2, 0.9), 0.25),))
    other = (0.975, -1.0, 0.5, 0.3)
    (found,) = bystanders(0, HERE, sighting(PERSON, other), world, 0.8)
    assert found.y < 0.0


def start(*tracks):
    """The start of a plan beside somebody, with tracks of others."""
    seen = Observation(0, HERE, tracks, sighting(PERSON))
    return Estimator(SETTINGS).update(seen, WORLD, ROBOT.at_rest).start


def test_without_people_everything_stays_where_it_is():
    assert start().reachable.names == ()


def test_among_people_the_robot_can_stop_before_they_set_off():
    among = start(FAR_AWAY)
    assert among.reachable.names == ('person 1', 'somebody standing')
    reach = ReachCheck(SETTINGS, SETTINGS.robot_radius)

    def reason(speed):
        wheels = np.arange(speed / ROBOT.wheel_radius, 0.0, -SETTINGS.max_wheel_change)
        return reach.reason(among, np.outer(wheels, [1.0, 1.0]), np.full(len(wheels), 0.2))

    assert reason(1.5).startswith('somebody standing could be ')
    assert reason(0.3) == ''
