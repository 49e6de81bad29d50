"""People who have stopped count as static for sensors, yet the promise covers them."""

from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceSettings, MovingObstacles, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.prediction.estimator import Estimator
from cmpsp_ros.guidance.safety.reach_check import ReachCheck
from cmpsp_ros.guidance.world import World
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.grids import Cell, OccupancyGrid
from cmpsp_ros.world.roads import OpenFloor

STEP = 200_000_000
ROBOT = DifferentialDrive(
    wheel_radius=0.0357, half_track=0.1165, max_wheel_speed=8.5, max_wheel_acceleration=25.0
)
SETTINGS = GuidanceSettings(
    robot=ROBOT,
    road=OpenFloor(),
    goal=(5.0, 0.0),
    final_time=30.0,
    robot_radius=0.175,
    moving_obstacles=MovingObstacles(capacity=8),
)
PERSON = Track(Track.SEEN + 1, 0, 0.25, 0.0, 0.45, 0.1, 0.0, 0.02, 0.13)


def sighting(*occupied):
    """A grid of free cells around the origin, some of which are occupied."""
    cells = np.zeros((80, 80), np.uint8)
    grid = OccupancyGrid((-2.0, -2.0, 0.0), 0.05, cells)
    for point in occupied:
        cells[grid.indices(np.array(point))] = Cell.OCCUPIED
    return Sighting(0, grid)


def after(*tracks, there, before=PERSON, beside=None):
    """Estimate of the step after one in which somebody was tracked."""
    estimator, world, rest = Estimator(SETTINGS), World(OpenFloor()), ROBOT.at_rest
    beside = beside or sighting()
    estimator.update(Observation(0, np.zeros(3), (before,), beside), world, rest)
    seen = Observation(STEP, np.zeros(3), tracks, there)
    return estimator.update(seen, world, rest).start


STOPPED = sighting((0.0, 0.25))


ASIDE = sighting((0.0, 0.13))


@pytest.mark.parametrize(
    ('before', 'there'),
    [(PERSON, STOPPED), (PERSON, ASIDE), (replace(PERSON, vx=0.38), STOPPED)],
    ids=['slow', 'aside', 'in doubt'],
)
def test_one_who_has_stopped_may_set_off_again(before, there):
    start = after(there=there, before=before)
    assert (start.moving.names, start.reachable.names) == ((), ('person 1',))
    x, y, vx, vy, *_ = start.reachable.states[0].tolist()
    assert (x, y, vx, vy) == (0.0, 0.45, 0.0, 0.0)


@pytest.mark.parametrize('direction', [(1.0, 0.0), (-0.6, -0.8), (0.0, -1.0)])
def test_who_sets_off_is_where_they_may_be_before_they_are_tracked_again(direction):
    estimator, world, rest = Estimator(SETTINGS), World(OpenFloor()), ROBOT.at_rest
    bearings = np.linspace(-np.pi, 0.0, 40)
    facing = 0.23 * np.column_stack([np.cos(bearings), np.sin(bearings)])
    person = replace(PERSON, y=1.2, vx=0.0)

    def place(seconds):
        return np.array([0.0, 1.2]) + 0.5 * max(seconds, 0.0) ** 2 * np.array(direction)

    # After 0.8 s they are tracked again.
    for step in range(19):
        now, tracks = 0.2 * step - 3.0, (person,) if step == 0 else ()
        seen = sighting(*(place(now) + facing)) if step else sighting()
        here = Observation(step * STEP, np.zeros(3), tracks, seen)
        start = estimator.update(here, world, rest).start
        for later in (0.2, 0.5, 1.0):
            centers, radii = start.reachable.at_times(np.array([later]))
            away = np.hypot(*(place(now + later) - centers[0, 0])) + person.radius
            assert away <= radii[0, 0] + 1e-9


def test_who_has_stopped_may_have_set_off_since_they_were_last_in_sight():
    estimator, world, rest = Estimator(SETTINGS), World(OpenFloor()), ROBOT.at_rest
    hidden = sighting((0.0, 0.25))
    hidden.grid.cells[hidden.grid.cells == Cell.FREE] = Cell.REMEMBERED
    radii = []
    for step in range(40):
        tracks, seen = ((PERSON,), sighting()) if step == 0 else ((), STOPPED)
        here = Observation(step * STEP, np.zeros(3), tracks, hidden if step > 4 else seen)
        start = estimator.update(here, world, rest).start
        radii.append(start.reachable.states[0, 4] if start.reachable.names else 0.0)
    # In sight they are where they were, behind it for 6 s anywhere from there on.
    assert radii[2] == pytest.approx(radii[4])
    assert np.diff(radii[4:30]).min() > 0.0
    assert radii[30] > 8.0
    assert radii[39] == 0.0


@pytest.mark.parametrize(
    ('before', 'tracks', 'there'),
    [
        (PERSON, (), sighting((1.0, 1.0))),
        (PERSON, (), None),
        (replace(PERSON, vx=0.9), (), STOPPED),
        (replace(PERSON, id=1), (), STOPPED),
    ],
    ids=['left', 'not seen', 'was fast', 'told'],
)
def test_nobody_else_is_remembered(before, tracks, there):
    assert after(*tracks, there=there, before=before).reachable.names == ()


def test_a_wall_beside_a_track_that_ends_is_nobody_who_stands():
    wall, shifted = [(0.05 * k + 0.02, 0.67) for k in range(-8, 9)], (0.0, 0.62)
    near = sighting(*wall)
    assert after(there=sighting(*wall, shifted), beside=near).reachable.names == ()
    assert after(there=sighting(*wall, (0.0, 0.25)), beside=near).reachable.names == ('person 1',)


def test_one_who_sets_off_is_not_there_twice():
    moving = replace(PERSON, stamp=STEP, x=0.1)
    start = after(moving, there=STOPPED)
    assert (start.moving.names, start.reachable.names) == (('person 1',), ('person 1',))


def test_beside_somebody_who_stands_the_robot_creeps_until_it_could_stop_in_time():
    start = after(there=STOPPED)
    check = ReachCheck(SETTINGS, SETTINGS.robot_radius)

    def reason(speed, seconds=0.2):
        controls = ROBOT.controls(np.array([speed, 0.0]))[None]
        return check.reason(start, controls, np.array([seconds]))

    assert reason(0.2) == 'person 1 could be 0.435 m into the robot before it is at rest.'
    assert reason(0.05) == ''
    assert check.reason(start, ROBOT.at_rest[None], np.array([1.0])) == ''
