"""Numbers of another unit are allowed, and warned of."""

import pytest

from cmpsp_ros.parameters import TABLE, load_parameter_file, plausibility_warnings
from cmpsp_ros.parameters.files import load_robot, preset_names, robot_names


@pytest.mark.parametrize('name', preset_names())
def test_presets_and_robots_are_in_metres_and_radians(name):
    given = load_parameter_file(name)
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
    ],
)
def test_what_looks_like_another_unit_is_named(key, value, unit):
    (said,) = plausibility_warnings(TABLE.resolve({key: value}))
    assert said.startswith(f'{key} = ')
    assert f'looks like {unit}' in said


def test_headings_of_waypoints_too():
    waypoint = {'waypoints.names': ['a'], 'waypoints.a.time': 2.0}
    given = {**waypoint, 'waypoints.a.position': [1.0, 2.0], 'waypoints.a.heading': [45.0]}
    (said,) = plausibility_warnings(TABLE.resolve(given))
    assert said.startswith('waypoints.a.heading = 45 ')


@pytest.mark.parametrize(('timeout', 'said'), [(0.0, 0), (0.25, 0), (0.2, 1), (0.1, 1)])
def test_a_robot_that_stops_between_two_commands_is_told(timeout, said):
    found = list(plausibility_warnings(TABLE.resolve({'cmd_vel_timeout': timeout})))
    assert len(found) == said
    assert all(each.startswith('control_period = 0.2 s is not shorter than') for each in found)
