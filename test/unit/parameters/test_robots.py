"""Robots that people own: every file is whole, and says nothing of a course."""

import pytest

from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    config_directory,
    guidance_settings,
    load_parameter_file,
)
from cmpsp_ros.parameters.files import load_robot, robot_names

# The makers' figures: speed [m/s], distance of the wheels [m]; of mecanum wheels of both axes.
MAKERS = {
    'jackal': (2.0, 0.37559 * 1.5),
    'mecanum': (0.8, (0.27 + 0.17) * 0.95),
    'turtlebot3_burger': (0.22, 0.160),
    'turtlebot3_waffle': (0.26, 0.287),
    'turtlebot4': (0.306, 0.233),
}


# The makers' figures: speed [m/s], wheel base [m], steering angle [rad].
CARS = {'car': (13.8, 2.579, 1.066), 'f1tenth': (5.0, 0.3302, 0.4189)}


def refusal(path_or_name):
    with pytest.raises(ParameterError) as caught:
        load_robot(str(path_or_name))
    return str(caught.value)


def test_the_robots_are_those_with_known_figures():
    assert robot_names() == sorted(MAKERS | CARS)


@pytest.mark.parametrize('name', sorted(MAKERS))
def test_a_robot_fits_a_course_and_is_what_its_maker_says(name):
    given = load_robot(name)
    assert {'robot.wheel_radius', 'robot.half_track', 'robot.max_wheel_speed', 'robot.radius'} <= (
        set(given)
    )
    values = TABLE.resolve(load_parameter_file('case3_wide') | given)
    check_simulation(values)
    settings = guidance_settings(values)
    speed, separation = MAKERS[name]
    assert speed - 1e-4 < settings.robot.max_speed <= speed
    assert settings.robot.half_track == pytest.approx(separation / 2.0, abs=1e-4)
    # No footprint is narrower than the wheels are apart, skidding left aside.
    assert settings.robot_radius > settings.robot.half_track
    assert settings.initial_guess.type == 'road'


@pytest.mark.parametrize('name', sorted(CARS))
def test_a_car_fits_a_course_and_is_what_its_maker_says(name):
    given = load_robot(name)
    wide = {'road.left_width': [9.0], 'road.right_width': [5.0]}
    values = TABLE.resolve(load_parameter_file('lane_change') | wide | given)
    check_simulation(values)
    settings = guidance_settings(values)
    robot = settings.robot
    assert (robot.max_speed, robot.wheel_base, robot.max_steering_angle) == CARS[name]
    assert settings.robot_radius > robot.wheel_base
    page = (config_directory().parent / 'doc' / 'user' / 'robots.md').read_text(encoding='utf-8')
    speed, base, angle = CARS[name]
    radius = settings.robot_radius
    assert f'| `{name}` | {base} m | {angle} rad | {speed} m/s | {radius} m |' in page


@pytest.mark.parametrize('name', robot_names())
def test_every_figure_of_a_robot_has_its_source_in_a_comment(name):
    lines = (config_directory() / 'robots' / f'{name}.yaml').read_text().splitlines()
    commented = False
    for line in map(str.strip, lines[lines.index('    robot:') + 1 :]):
        if line.startswith(('half_track', 'type', 'model')):
            continue
        assert line.startswith('#') or commented, line
        commented = line.startswith('#')


def test_a_robot_misspelt():
    message = refusal('turtlebot3_burgr')
    assert message.startswith("'turtlebot3_burgr': found no such robot, wanted a robot (car, ")
    assert message.endswith('(did you mean turtlebot3_burger?)')


def test_a_robot_of_the_user(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/**:\n  ros__parameters:\n    robot: {wheel_radius: 0.05}\n')
    assert load_robot(str(path)) == {'robot.wheel_radius': 0.05}
    path.write_text('/**:\n  ros__parameters:\n    command_delay: 0.1\n    max_wheel_lag: 0.2\n')
    assert load_robot(str(path)) == {'command_delay': 0.1, 'max_wheel_lag': 0.2}
    path.write_text('/**:\n  ros__parameters:\n    robot: {radius: 0.1}\n    final_time: 3.0\n')
    assert 'found final_time in the file of a robot, wanted only robot.*' in refusal(path)
    assert 'No such file' in refusal(tmp_path / 'none.yaml')


@pytest.mark.parametrize('name', sorted(MAKERS))
def test_the_page_about_robots_has_its_figures(name):
    page = (config_directory().parent / 'doc' / 'user' / 'robots.md').read_text(encoding='utf-8')
    said = {key.removeprefix('robot.'): value for key, value in load_robot(name).items()}
    wheel, track, radius = (said[key] for key in ('wheel_radius', 'half_track', 'radius'))
    speed = MAKERS[name][0]
    assert f'| `{name}` | {wheel} m | {track} m | {speed} m/s | {radius} m |' in page
