"""Courses and robots from parameters: roads, obstacles, goals, models, footprints."""

import math

import pytest
from given_courses import BEND, CAR, MECANUM, SQUARE, THREE, WAYPOINTS

from cmpsp_ros.guidance import Follow, Goal
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    guidance_settings,
    load_parameter_file,
    plant_settings,
    plausibility_warnings,
    road_keys,
    shapes_of,
)
from cmpsp_ros.parameters.obstacles import obstacles_of
from cmpsp_ros.parameters.roads import road_of
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.obstacles import Capsule, Obstacle
from cmpsp_ros.world.obstacles.shapes import Polygon
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor


def on_the_bend(**changes):
    return TABLE.resolve(BEND | {k.replace('__', '.'): v for k, v in changes.items()})


def test_each_type_makes_its_road():
    assert road_of(TABLE.resolve({})) == Annulus()
    assert road_of(on_the_bend(road__type='none')) == OpenFloor()
    road = road_of(on_the_bend(road__half_width=[0.5], road__left_width=[0.4, 0.5, 0.6, 0.7]))
    points = ((0.0, 0.0), (3.0, 0.0), (6.0, 1.0), (8.0, 3.0))
    assert road == Corridor(points, (0.4, 0.5, 0.6, 0.7), (0.5,) * 4, closed=False)
    for given in (TABLE.resolve({}), on_the_bend(), on_the_bend(road__type='none')):
        assert set(road_keys(given)) <= set(given)


def test_open_floor_refuses_no_place_but_an_obstacle():
    obstacle = {'obstacles.names': ['a'], 'obstacles.a.center': [1.0, 0.0]}
    given = TABLE.resolve({'road.type': 'none', 'obstacles.a.radius': 0.5, **obstacle})
    assert guidance_settings(given).road == OpenFloor()
    guidance_settings(given | {'goal.position': [1e3, -1e3]})
    with pytest.raises(ParameterError, match='obstacle a'):
        guidance_settings(given | {'goal.position': [1.2, 0.0]})


def test_only_an_annulus_is_one():
    assert guidance_settings(TABLE.resolve({})).world.annulus == Annulus()
    with pytest.raises(ValueError, match=r'road\.type: found corridor, wanted annulus'):
        assert guidance_settings(on_the_bend()).world.annulus
    assert math.isclose(road_of(on_the_bend()).width, 2.0)


def obstacle(kind, **block):
    values = {f'obstacles.a.{key}': value for key, value in block.items()}
    return TABLE.resolve({'obstacles.names': ['a'], 'obstacles.a.type': kind, **values})


@pytest.mark.parametrize(
    ('values', 'wanted'),
    [
        (obstacle('circle', center=[8, -6], radius=0.7), Obstacle('a', (8.0, -6.0), 0.7)),
        (
            obstacle('capsule', start=[8, -6], end=[9, -5], radius=0.1),
            Capsule('a', (8.0, -6.0), (9.0, -5.0), 0.1),
        ),
        (
            obstacle('polygon', vertices=SQUARE),
            Polygon('a', ((9.5, -3.0), (10.5, -3.0), (10.5, -2.0), (9.5, -2.0))),
        ),
    ],
)
def test_every_type(values, wanted):
    assert obstacles_of(values) == (wanted,)
    assert guidance_settings(values).obstacles == (wanted,)
    check_simulation(values)


def test_obstacles_of_the_simulator_are_no_others():
    block = {'type': 'capsule', 'start': [0, 0], 'end': [1, 0], 'radius': 0.1}
    values = TABLE.resolve(
        {
            'sim.obstacles.names': ['wall'],
            **{f'sim.obstacles.wall.{k}': v for k, v in block.items()},
        }
    )
    assert shapes_of(values) == (Capsule('wall', (0.0, 0.0), (1.0, 0.0), 0.1),)
    assert obstacles_of(values) == ()


def test_goals_in_their_order():
    settings = guidance_settings(TABLE.resolve(WAYPOINTS | {'goal.heading': [1.6]}))
    assert settings.goals == (
        Goal((7.0, -7.0), 4.0, None, 'a'),
        Goal((9.5, -3.0), 8.0, 1.2, 'b'),
        Goal((10.0, 0.0), 10.0, 1.6, 'goal'),
    )
    assert guidance_settings(TABLE.resolve({})).goals == (Goal((10.0, 0.0), 10.0),)


def test_one_leg_has_one_goal_and_its_own_time():
    settings = guidance_settings(TABLE.resolve(WAYPOINTS))
    leg = settings.towards(settings.goals[1], 4.0)
    assert leg.goals == (Goal((9.5, -3.0), 4.0, 1.2),)


def test_a_road_without_end():
    settings = guidance_settings(TABLE.resolve({'follow.speed': -1.0, 'final_time': 0.0}))
    assert settings.follow == Follow(-1.0, 5.0)
    assert settings.goals == ()
    assert settings.final_time == math.inf


def made(**changes):
    return guidance_settings(TABLE.resolve(load_parameter_file('case3') | changes))


def test_a_robot_without_a_model_is_the_differential_drive():
    assert isinstance(made().robot, DifferentialDrive)


@pytest.mark.parametrize(('given', 'wheels'), [(MECANUM, 4), (THREE, 3)])
def test_robots_that_drive_sideways(given, wheels):
    robot = made(**given).robot
    assert robot.drives_sideways
    assert robot.wheels.shape == (wheels, 3)
    assert robot.max_wheel_speed == 51.0
    assert plant_settings(TABLE.resolve(load_parameter_file('case3') | given)).robot == robot


def test_a_car():
    limited = {'robot.max_steering_rate': 0.4, 'robot.max_wheel_acceleration': 10.0}
    robot = made(**(CAR | limited)).robot
    assert (robot.wheel_base, robot.max_steering_angle, robot.max_steering_rate) == (2.5, 0.6, 0.4)
    assert not robot.turns_on_the_spot
    assert math.isinf(made(**CAR).robot.max_steering_rate)


BOX = '[[-0.2, -0.15], [0.1, -0.15], [0.1, 0.15], [-0.2, 0.15]]'


def values(preset=None, **changes):
    given = {'road.type': 'none'} if preset is None else load_parameter_file(preset)
    return TABLE.resolve(given | {key.replace('__', '.'): each for key, each in changes.items()})


def test_a_footprint_counts_instead_of_the_radius():
    given = values(robot__footprint=BOX, robot__radius=3.0)
    settings = guidance_settings(given)
    assert settings.footprint.corners[0] == (-0.2, -0.15)
    assert settings.robot_radius == pytest.approx(math.hypot(0.15, 0.075), rel=1e-8)
    assert settings.inscribed_radius == pytest.approx(0.1)
    assert 'robot.radius does not count' in ' '.join(plausibility_warnings(given))
    assert not list(plausibility_warnings(values(robot__footprint=BOX)))


def test_without_one_the_robot_is_a_disc():
    settings = guidance_settings(values(robot__radius=0.2))
    assert settings.footprint.centers == ((0.0, 0.0),)
    assert settings.robot_radius == settings.inscribed_radius == 0.2


@pytest.mark.parametrize(
    'text',
    [
        BOX.replace(' ', ''),
        '[[-.2, -.15], [+.1, -15e-2], [1e-1, .15], [-.2, .15]]',
        '[[-1, -1], [1, -1], [0, 1]]',
        '[[-0.2, 0.15], [0.1, 0.15], [0.1, -0.15], [-0.2, -0.15]]',
        '[[-1, -1], [0.5, -0.1], [2, -1], [0, 1]]',
        '[[-1, -1], [0, -1], [1, -1], [0, 1]]',
    ],
    ids=['tight', 'floats', 'integers', 'clockwise', 'not convex', 'corner on a side'],
)
def test_what_can_be_read(text):
    given = values(robot__footprint=text)
    assert len(guidance_settings(given).footprint.corners) == text.count('[') - 1


def test_millimetres():
    given = values(robot__footprint=BOX.replace('0.', '100.'))
    assert 'robot.footprint looks like millimetres' in ' '.join(plausibility_warnings(given))


def test_a_long_robot_may_begin_along_a_wall_and_not_across():
    """The wall is 0.3 m to the left of it."""
    given = {
        'robot__footprint': '[[-0.2, -0.2], [1.0, -0.2], [1.0, 0.2], [-0.2, 0.2]]',
        'obstacles__names': ['wall'],
        'obstacles.wall.type': 'polygon',
        'obstacles.wall.vertices': [-3.0, 0.3, 3.0, 0.3, 3.0, 0.5, -3.0, 0.5],
        'goal__position': [2.0, 0.0],
        'goal__heading': [0.0],
        'initial_pose': [0.0, 0.0, 0.0],
    }
    check_simulation(values(**given))
    guidance_settings(values(**given))
    turned = values(**given | {'initial_pose': [0.0, 0.0, 0.5], 'goal__heading': [0.5]})
    with pytest.raises(
        ParameterError, match=r'initial_pose: found .* inside or beyond obstacle wall'
    ):
        check_simulation(turned)
    with pytest.raises(ParameterError, match=r'goal\.position: found .* beyond obstacle wall'):
        guidance_settings(turned)
    # Where the heading is free some may do.
    guidance_settings(values(**given | {'goal__heading': []}))
    with pytest.raises(ParameterError, match=r'goal\.position'):
        guidance_settings(values(**given | {'goal__heading': [], 'goal__position': [2.0, 0.15]}))
