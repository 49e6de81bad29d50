"""Speeds of a robot that somebody could reach before it is at rest."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceLaw, GuidanceSettings, MovingObstacles, Observation, Safety
from cmpsp_ros.guidance.commands.looking import turn_to_look
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.messages import PeerTrajectory, Track
from cmpsp_ros.guidance.planning import PlanningContext
from cmpsp_ros.guidance.planning.retreat import RetreatPlanner
from cmpsp_ros.guidance.prediction.estimator import Estimator, PlanStart
from cmpsp_ros.guidance.safety.reach_check import ReachCheck
from cmpsp_ros.guidance.safety.unseen import is_clear_of_unseen, watches_unseen
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.guidance.times import Horizon
from cmpsp_ros.guidance.world import MAP, World
from cmpsp_ros.robots import DifferentialDrive, Omnidirectional
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import MovingDiscs
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


@pytest.mark.parametrize(
    ('place', 'speed', 'said'), [(1.0, -0.8, 'robot /b could be'), (0.5, 0.8, '')]
)
def test_another_robot_goes_the_way_that_it_has_told(place, speed, said):
    stamps = tuple(k * 200_000_000 for k in range(11))
    peer = PeerTrajectory('/b', 0, stamps, tuple((place + speed * t / 1e9, 0.0) for t in stamps))
    room = MovingObstacles(others=('/b',), others_radius=0.175)
    given = replace(SETTINGS, moving_obstacles=room)
    seen = Observation(0, np.zeros(3), (peer,))
    start = Estimator(given).update(seen, World(OpenFloor()), ROBOT.at_rest).start
    ahead = ROBOT.controls(np.array([0.3, 0.0]))[None]
    found = ReachCheck(given, given.robot_radius).reason(start, ahead, np.array([1.0]))
    assert found.startswith(said)
    assert bool(found) is bool(said)


def settings(sight='stationary'):
    return GuidanceSettings(
        robot=DifferentialDrive(wheel_radius=0.05, half_track=0.15, max_wheel_speed=20.0),
        road=OpenFloor(),
        goal=(3.0, 0.0),
        final_time=10.0,
        robot_radius=0.2,
        safety=Safety(stop_within_sight=sight),
    )


def start(*, behind=Cell.REMEMBERED, among_people=True):
    """A robot that looks ahead on free ground, and what it knows of the ground behind it."""
    cells = np.zeros((80, 80), np.uint8)
    cells[:, :37] = behind
    world = World(OpenFloor()).seeing(OccupancyGrid((-4.0, -4.0, 0.0), 0.1, cells))
    return PlanStart(np.zeros(3), settings().robot, world, among_people=among_people)


@pytest.mark.parametrize(
    ('speed', 'behind', 'clear'),
    [
        (0.5, Cell.REMEMBERED, True),
        (-0.5, Cell.REMEMBERED, False),
        (-0.05, Cell.REMEMBERED, True),
        (-0.5, Cell.FREE, True),
    ],
)
def test_it_backs_no_faster_than_it_creeps_where_it_does_not_look(speed, behind, clear):
    given = settings()
    controls = given.robot.controls(np.array([speed, 0.0]))[None]
    held = np.array([given.control_period])
    assert is_clear_of_unseen(given, start(behind=behind), controls, held) is clear


SLOWING = np.array([0.6, 0.4, 0.2, 0.1])


def is_clear_in(ground, side, *, heading=0.0, sideways=False, known=None):
    """Verdict on a robot in the middle of some ground that drives to the left and then stops."""
    world, given = World(OpenFloor()), settings('moving')
    if known is not None:
        grid = OccupancyGrid((-4.0, -4.0, 0.0), 0.1, np.full((80, 80), known, np.uint8))
        world = replace(world, obstacles=(GridObstacle(MAP, grid),))
    world = world.seeing(OccupancyGrid((-side, -side, 0.0), 0.1, ground))
    robot = Omnidirectional.mecanum(0.15, 0.15, wheel_radius=0.05, max_wheel_speed=40.0)
    ahead = [0.0, 1.0, 0.0] if sideways else [1.0, 0.0, 0.0]
    controls = np.array([robot.controls(speed * np.array(ahead)) for speed in SLOWING])
    here = PlanStart(np.array([0.0, 0.0, heading]), robot, world, among_people=True)
    return is_clear_of_unseen(replace(given, robot=robot), here, controls, np.full(4, 0.2))


@pytest.mark.parametrize('sideways', [False, True])
def test_to_the_side_and_ahead_it_is_as_slow_before_a_corner(sideways):
    ground = np.zeros((80, 80), np.uint8)
    heading = 0.0 if sideways else math.pi / 2.0
    assert is_clear_in(ground, 4.0, heading=heading, sideways=sideways)
    ground[44:, :39] = Cell.UNKNOWN
    assert not is_clear_in(ground, 4.0, heading=heading, sideways=sideways)


@pytest.mark.parametrize(('delay', 'clear'), [(0.0, True), (0.4, False)])
def test_somebody_out_of_sight_comes_nearer_before_a_command_takes_effect(delay, clear):
    given, here = settings('moving'), start()
    cells = np.zeros((80, 100), np.uint8)
    cells[:, 62:] = Cell.UNKNOWN
    world = here.world.seeing(OccupancyGrid((-4.0, -4.0, 0.0), 0.1, cells))
    controls = np.array([given.robot.controls(np.array([speed, 0.0])) for speed in SLOWING])
    here, held = here._replace(world=world), np.full(4, 0.2)
    assert is_clear_of_unseen(given, here, controls, held, delay) is clear


@pytest.mark.parametrize('delay', [0.0, 0.4])
def test_with_a_delay_it_is_slower_before_what_is_out_of_sight(delay):
    """From the odometry on nobody out of sight reaches the robot before it is at rest."""
    given = replace(settings('moving'), command_delay=delay, goal=(8.0, 0.0))
    given = replace(given, robot=replace(given.robot, max_wheel_acceleration=40.0))
    law, pose, speeds = GuidanceLaw(given, given.world), np.zeros(3), [0.0] * round(delay / 0.2)
    cells = np.zeros((100, 120), np.uint8)
    cells[:, 80:] = Cell.UNKNOWN
    grid = OccupancyGrid((-2.0, -2.5, 0.0), 0.05, cells)
    for k in range(20):
        decision = law.step(Observation(k * 200_000_000, pose, (), Sighting(0, grid, ())))
        law.after_step()
        speeds.append(float(decision.twist[0]))
        if speeds[-1] > 0.11:
            # A period with this command, and its stop.
            ramp = np.arange(speeds[-1], 0.0, -40.0 * 0.05 * 0.2)
            seconds, driven = delay + 0.2 * len(ramp), 0.2 * (sum(speeds[k:-1]) + ramp.sum())
            assert pose[0] + driven + 0.2 < 2.0 - 1.6 * seconds + 0.01
        pose = np.add(pose, [0.2 * speeds[k], 0.0, 0.0])
    assert max(speeds) > 0.11


def test_somebody_may_come_from_beyond_the_grid():
    assert is_clear_in(np.zeros((80, 80), np.uint8), 4.0, heading=math.pi / 2.0)
    assert not is_clear_in(np.zeros((20, 20), np.uint8), 1.0, heading=math.pi / 2.0)


@pytest.mark.parametrize(('known', 'clear'), [(Cell.FREE, False), (Cell.OCCUPIED, True)])
def test_where_a_map_has_free_space_somebody_may_be_all_the_same(known, clear):
    ground = np.zeros((80, 80), np.uint8)
    ground[44:] = Cell.UNKNOWN
    assert is_clear_in(ground, 4.0, heading=math.pi / 2.0, known=known) is clear


@pytest.mark.parametrize(
    ('sight', 'among_people', 'watches'),
    [
        ('off', True, False),
        ('stationary', False, False),
        ('stationary', True, True),
        ('moving', False, True),
    ],
)
def test_who_may_be_out_of_sight_matters_where_people_have_been_seen(sight, among_people, watches):
    assert watches_unseen(settings(sight), start(among_people=among_people)) is watches


@pytest.mark.parametrize(('behind', 'sense'), [(Cell.FREE, -1.0), (Cell.REMEMBERED, 1.0)])
def test_it_turns_to_look_before_it_backs_off(behind, sense):
    given, here = settings(), start(behind=behind)
    comes = np.array([[4.5, 0.0, -0.8, 0.0, 2.5, 0.0, 0.0]])
    threats = MovingDiscs(('trolley',), comes, np.array([0]))
    horizon = Horizon.between([k * 200_000_000 for k in range(21)])
    context = PlanningContext(given, here, given.target, horizon)
    found = RetreatPlanner(given).find(context, threats, None)
    assert found is not None
    speeds = given.robot.twist(found[0].controls)[:, 0]
    assert np.sign(speeds[speeds != 0.0][0]) == sense
    assert found[0].poses[-1, 0] < -0.5


HORIZON = Horizon.between([k * 200_000_000 for k in range(21)])


def look(person, doubt, speed, **there):
    """Turn of a robot whose plan has been slowed to a speed, with a person as lost as that [m]."""
    given = settings()
    discs = [
        MovingDiscs(('person 1',), np.array([[*person, 0.25 + more, 0.3, 1.0]]), np.array([-1]))
        for more in (doubt, 0.0)
    ]
    here = start(**there)._replace(reachable=discs[0], touchable=discs[1])
    context = PlanningContext(given, here, Target((3.0, 0.0)), HORIZON)
    controls = np.tile(given.robot.controls(np.array([speed, 0.0])), (21, 1))
    poses = given.robot.roll_out(here.pose, controls, HORIZON.durations)
    return turn_to_look(Validator(given), context, Plan(HORIZON, controls, poses, 0))


@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_it_turns_to_look_for_somebody_who_may_come_from_behind(side):
    plan, verdict, remark = look((-1.5, 0.4 * side, 0.5, 0.0), 0.8, 0.04)
    along, turn = settings().robot.twist(plan.controls[0])
    assert (along, np.sign(turn)) == (pytest.approx(0.0), side)
    assert (verdict.passed, remark) == (True, ' It turns to look for person 1.')


@pytest.mark.parametrize(
    ('person', 'doubt', 'speed', 'there'),
    [
        ((-1.5, 0.4, 0.5, 0.0), 0.3, 0.04, {}),
        ((-1.5, 0.4, 0.5, 0.0), 0.8, 0.2, {}),
        ((-1.5, 0.4, 0.5, 0.0), 0.8, 0.04, {'behind': Cell.FREE}),
        ((1.5, 0.4, -0.5, 0.0), 0.8, 0.04, {}),
        ((-3.9, 3.0, -0.5, 0.0), 0.8, 0.04, {}),
    ],
    ids=['seen lately', 'not slow', 'in view', 'hidden ahead', 'far away'],
)
def test_it_does_not_turn_for_anybody_else(person, doubt, speed, there):
    assert look(person, doubt, speed, **there) is None
