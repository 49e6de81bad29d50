"""Settings: built from a resolved set, and checked against each other."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.guidance import (
    GuidanceSettings,
    InitialGuess,
    MovingObstacles,
    Safety,
    SolverSettings,
    Weights,
)
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
    plausibility_warnings,
)
from cmpsp_ros.parameters.files import load_robot, preset_names, robot_names
from cmpsp_ros.parameters.parameter import ParameterType
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.sensing import SightSettings
from cmpsp_ros.setting import settings_of
from cmpsp_ros.simulator import LaserSettings, OdometryErrors, PlantSettings
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus

DISC = {'obstacles.names': ['a'], 'obstacles.a.center': [10.0, 0.5], 'obstacles.a.radius': 0.4}


def refusal(build, values):
    with pytest.raises(ParameterError) as caught:
        build(TABLE.resolve(values))
    return str(caught.value).splitlines()


SECTIONS = (
    (GuidanceSettings, '', lambda law, _: law), (Weights, 'weights.', lambda law, _: law.weights),
    (SolverSettings, 'solver.', lambda law, _: law.solver),
    (InitialGuess, 'initial_guess.', lambda law, _: law.initial_guess),
    (Safety, 'safety.', lambda law, _: law.safety),
    (MovingObstacles, 'moving_obstacles.', lambda law, _: law.moving_obstacles),
    (SightSettings, 'sight.', lambda law, _: law.sight),
    (PlantSettings, '', lambda _, values: plant_settings(values)),
    (OdometryErrors, 'noise.', lambda _, values: plant_settings(values).odometry),
    (LaserSettings, 'sim.scan.', lambda _, values: laser_settings(values)),
)  # fmt: skip
"""Dataclasses of settings, the prefixes of their parameters, and where they are."""


def another(row):
    """A value that is not the default."""
    if row.choices:
        return next(each for each in row.choices if each != row.default)
    if isinstance(row.default, bool):
        return not row.default
    if row.name == 'solver.qp':
        return 'clarabel'
    if isinstance(row.default, str):
        return 'other'
    if row.type is ParameterType.STRING_ARRAY:
        return ['/r1']
    if isinstance(row.default, list):
        return [each + 0.25 for each in row.default]
    return row.default + 1 if isinstance(row.default, int) else row.default * 0.98 + 1e-4


@pytest.mark.parametrize(('kind', 'prefix', 'find'), SECTIONS)
def test_every_declared_setting_reaches_its_field(kind, prefix, find):
    for field, declared in settings_of(kind).items():
        key = declared.key or f'{prefix}{field}'
        # The simulated scanner has no settings before it has a rate.
        values = TABLE.resolve({'sim.scan.rate': 5.0} | {key: another(TABLE.find(key))})
        found = getattr(find(guidance_settings(values), values), field)
        assert found == (tuple(values[key]) if isinstance(values[key], list) else values[key])
        assert found != getattr(kind, field), key


def test_defaults_of_table_and_settings_agree():
    robot = DifferentialDrive(max_wheel_speed=51.0)
    values = TABLE.resolve({})
    assert guidance_settings(values) == GuidanceSettings(robot, (10.0, 0.0), road=Annulus())
    assert plant_settings(values) == PlantSettings(robot)


def test_settings_that_are_made_of_others():
    values = TABLE.resolve({
        **DISC, 'robot.max_wheel_speed': 0, 'robot.radius': 0.1, 'goal.position': [-10, 0],
        'final_time': 12, 'noise.dropout_windows': [1, 2, 3.5, 4],
    })  # fmt: skip
    settings, plant = guidance_settings(values), plant_settings(values)
    assert settings.robot.max_wheel_speed == plant.robot.max_wheel_speed == math.inf
    assert settings.obstacles == (Obstacle('a', (10.0, 0.5), 0.4),)
    assert (settings.robot_radius, settings.goal, settings.final_time) == (0.1, (-10, 0), 12.0)
    assert plant.odometry.dropout_windows == ((1.0, 2.0), (3.5, 4.0))


def test_goal_exactly_on_the_edge_is_allowed():
    guidance_settings(TABLE.resolve({'goal.position': [11.0, 0.0]}))
    guidance_settings(TABLE.resolve({**DISC, 'obstacles.a.radius': 0.5}))


def test_the_start_of_the_paper_is_allowed():
    check_simulation(TABLE.resolve({}))


NUMBERS = st.floats(0.0, allow_infinity=False) | st.sampled_from([0.1, 0.5, 1.0, 9.0, 10.0])


@given(st.fixed_dictionaries({}, optional={
    'road.inner_radius': NUMBERS, 'road.outer_radius': NUMBERS, 'robot.radius': NUMBERS,
    'goal.position': st.tuples(NUMBERS, NUMBERS), 'initial_pose': st.tuples(*[NUMBERS] * 3),
    'final_time': NUMBERS, 'control_period': NUMBERS, 'safety.margin': NUMBERS,
}))  # fmt: skip
def test_any_set_builds_or_gives_a_parameter_error(values):
    for build in (guidance_settings, plant_settings, check_simulation):
        with contextlib.suppress(ParameterError):
            build(TABLE.resolve(values))


def test_in_lockstep_no_window_lasts_until_the_guidance_stops_by_its_clock():
    values = {'noise.dropout_windows': [1.0, 1.2, 3.0, 3.4]}
    check_simulation(TABLE.resolve(values))
    check_simulation(TABLE.resolve({**values, 'lockstep': True, 'odom_timeout': 0.7}))
    [line] = refusal(check_simulation, {**values, 'lockstep': True})
    assert line == (
        'noise.dropout_windows: found a window of 0.4 s, wanted at most odom_timeout -'
        ' control_period = 0.3 s, for lockstep'
    )


@pytest.mark.parametrize(
    ('rate', 'jitter', 'works'),
    [(50.0, 0.0, True), (5.0, 0.0, True), (30.0, 0.03, True), (30.0, 0.0, True), (10.0, 0.0, True),
     (10.0, 0.01, False), (7.0, 0.0, False)],
)  # fmt: skip
def test_in_lockstep_odometry_comes_within_half_a_control_period(rate, jitter, works):
    values = {'odom_rate': rate, 'odom_jitter': jitter}
    check_simulation(TABLE.resolve(values))
    if works:
        check_simulation(TABLE.resolve({**values, 'lockstep': True}))
    else:
        [line] = refusal(check_simulation, {**values, 'lockstep': True})
        assert line.startswith(f'control_period, odom_rate: found 0.2 s and {rate} Hz, wanted ')


def test_other_robots_are_named_by_namespaces():
    values = {'others.namespaces': ['/r1', '/floor_2/r2'], 'others.radius': 0.2}
    known = guidance_settings(TABLE.resolve(values)).moving_obstacles
    assert (known.others, known.others_radius, known.slots) == (('/r1', '/floor_2/r2'), 0.2, 2)


@pytest.mark.parametrize('name', preset_names())
def test_presets_and_robots_are_in_metres_and_radians(name):
    given = load_parameter_file(name, namespace='/r1')
    assert not list(plausibility_warnings(TABLE.resolve(given)))
    # Accelerations of cars are in m/s^2: no other robot is laid over them.
    is_of_car = given.get('robot.model') == 'ackermann'
    for robot in () if is_of_car else robot_names():
        assert not list(plausibility_warnings(TABLE.resolve({**given, **load_robot(robot)})))


@pytest.mark.parametrize(
    ('key', 'value', 'unit'),
    [
        ('robot.wheel_radius', 35.0, 'millimetres'),
        ('robot.half_track', 55.0, 'millimetres'),
        ('robot.radius', 220.0, 'millimetres'),
        ('robot.max_wheel_acceleration', 1.0, r'm/s^2'),
        ('safety.margin', 50.0, 'millimetres'),
        ('others.radius', 300.0, 'millimetres'),
        ('goal.tolerance', 10.0, 'millimetres'),
        ('solver.heading_trust_region', 34.0, 'degrees'),
        ('goal.heading', [90.0], 'degrees'),
        ('start.pose', [0.0, -9.25, 180.0], 'degrees'),
        ('initial_pose', [0.0, -9.25, -90.0], 'degrees'),
        ('sim.scan.pose', [0.0, 0.0, 90.0], 'degrees'),
    ],
)
def test_what_looks_like_another_unit_is_named(key, value, unit):
    (said,) = plausibility_warnings(TABLE.resolve({key: value}))
    assert said.startswith(f'{key} = ')
    assert f'looks like {unit}' in said


def test_a_robot_in_millimetres_that_fits_on_no_road_is_told_first():
    with pytest.raises(ParameterError) as refused:
        guidance_settings(TABLE.resolve({'robot.radius': 220.0}))
    wanted = 'robot.radius: found 220.0, wanted metres: it looks like millimetres'
    assert str(refused.value).splitlines()[0] == wanted


def test_headings_of_waypoints_too():
    waypoint = {'waypoints.names': ['a'], 'waypoints.a.time': 2.0}
    given = {**waypoint, 'waypoints.a.position': [1.0, 2.0], 'waypoints.a.heading': [45.0]}
    (said,) = plausibility_warnings(TABLE.resolve(given))
    assert said.startswith('waypoints.a.heading = 45 ')


@pytest.mark.parametrize(
    ('kind', 'key', 'value'),
    [
        ('annulus', 'road.points', [0.0, 0.0, 1.0, 0.0]),
        ('none', 'road.half_width', [2.0]),
        ('corridor', 'road.inner_radius', 8.0),
    ],
)
def test_parameters_of_another_type_of_road_are_named(kind, key, value):
    (said,) = plausibility_warnings(TABLE.resolve({'road.type': kind, key: value}))
    assert said == f'{key} does not count: road.type is {kind}.'


@pytest.mark.parametrize(('timeout', 'said'), [(0.0, 0), (0.25, 0), (0.2, 1), (0.1, 1)])
def test_a_robot_that_stops_between_two_commands_is_told(timeout, said):
    found = list(plausibility_warnings(TABLE.resolve({'cmd_vel_timeout': timeout})))
    assert len(found) == said
    assert all(each.startswith('control_period = 0.2 s is not shorter than') for each in found)
