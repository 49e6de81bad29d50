"""Parameter files: presets, the user's own, merging by node, and files for other processes."""

import shutil
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cmpsp_ros.bags.audit import CHECKS
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    config_directory,
    guidance_settings,
    load_parameter_file,
    plant_settings,
    road_keys,
)
from cmpsp_ros.parameters.files import (
    load_robot,
    parse_assignment,
    preset_names,
    robot_names,
    robots_in,
    write_fleet_file,
    write_parameter_file,
)

MERGED = """
guidance:
  ros__parameters: {odom_timeout: 0.1}
/**:
  ros__parameters: {odom_timeout: 0.2, final_time: 5.0}
/r1/guidance:
  ros__parameters: {final_time: 6.0}
/*/sim:
  ros__parameters: {noise.seed: 3}
camera:
  ros__parameters: {gain: 1}
"""


@pytest.fixture
def merged(tmp_path):
    path = tmp_path / 'merged.yaml'
    path.write_text(MERGED)
    return path


def refusal(call, *arguments):
    with pytest.raises(ParameterError) as caught:
        call(*arguments)
    return str(caught.value)


@pytest.mark.parametrize('name', preset_names())
def test_every_preset_builds_and_says_what_an_audit_judges_by(name):
    given_ = load_parameter_file(name, namespace='/r1')
    values = TABLE.resolve(given_)
    judged = {key for each in CHECKS for key in each.needs} - {'road', 'obstacles.names'}
    # A car has none.
    judged -= {'robot.half_track'} if values['robot.model'] == 'ackermann' else set()
    assert judged.union(road_keys(values), ['frame_id']) <= given_.keys()
    assert plant_settings(values).robot == guidance_settings(values).robot
    check_simulation(values)


@pytest.mark.parametrize(
    ('name', 'limit', 'obstacles'),
    [('case1', 0.0, []), ('case2', 0.0, ['a', 'b']), ('case3', 51.0, ['a', 'b']),
     ('case3_45', 45.0, ['a', 'b'])],
)  # fmt: skip
def test_presets_differ_from_the_defaults_only_as_the_cases_do(name, limit, obstacles):
    values = TABLE.resolve(load_parameter_file(name))
    discs = {
        'obstacles.a.center': [8.0, -6.0], 'obstacles.a.radius': 0.7,
        'obstacles.b.center': [10.0, -2.0], 'obstacles.b.radius': 0.5,
    }  # fmt: skip
    expected = {'robot.max_wheel_speed': limit, 'obstacles.names': obstacles}
    # The paper starts its cases from constant wheel speeds; it has no case with 45 rad/s.
    if name != 'case3_45':
        expected |= {'initial_guess.type': 'constant', 'solver.initial_iterations': 6}
    assert values == TABLE.resolve(expected | (discs if obstacles else {}))


def test_what_ros_hands_to_a_node(merged):
    assert load_parameter_file(merged, '/guidance') == {'odom_timeout': 0.2, 'final_time': 5.0}
    assert load_parameter_file(merged, 'r1/guidance') == {'odom_timeout': 0.2, 'final_time': 6.0}
    assert load_parameter_file(merged, '/r2/sim')['noise.seed'] == 3
    assert 'noise.seed' not in load_parameter_file(merged, '/r2/r3/sim')


def test_without_a_node_the_later_section_counts(merged):
    path = merged.with_name('a.yaml')
    path.write_text(MERGED.replace('guidance:\n', 'sim:\n', 1))
    expected = {'odom_timeout': 0.2, 'final_time': 6.0, 'noise.seed': 3}
    assert load_parameter_file(path) == expected


def test_contradictions_between_nodes_are_refused(tmp_path):
    path = tmp_path / 'two.yaml'
    path.write_text(
        'guidance:\n  ros__parameters: {frame_id: odom}\nsim:\n  ros__parameters: {frame_id: map}'
    )
    message = refusal(load_parameter_file, path)
    assert message == (
        f"{path}: frame_id: found 'odom' for /guidance and 'map' for /sim, "
        'wanted one value for both'
    )
    assert load_parameter_file(path, '/sim') == {'frame_id': 'map'}


FLEET = """
/**:
  ros__parameters: {final_time: 5.0, odom_timeout: 0.1}
/r2/**:
  ros__parameters: {final_time: 6.0}
r1/guidance:
  ros__parameters: {odom_timeout: 0.2}
/floor/r3:
  sim:
    ros__parameters: {odom_rate: 20.0}
"""


def test_a_file_of_several_robots(tmp_path):
    path = tmp_path / 'fleet.yaml'
    path.write_text(FLEET)
    assert robots_in(path) == ('/r2', '/r1', '/floor/r3')
    common = {'final_time': 5.0, 'odom_timeout': 0.1}
    expected = {
        '/r1': {'odom_timeout': 0.2},
        '/r2': {'final_time': 6.0},
        '/floor/r3': {'odom_rate': 20.0},
        '/r4': {},
    }
    for namespace, own in expected.items():
        assert load_parameter_file(path, namespace=namespace) == common | own
    assert robots_in('fleet') == ('/r1', '/r2', '/r3', '/r4')
    assert robots_in('case3') == ()


def test_values_of_several_robots_are_refused_until_one_is_selected(tmp_path):
    path = tmp_path / 'fleet.yaml'
    path.write_text(f'{FLEET}\n/r1/**:\n  ros__parameters: {{final_time: 7.0, odom_timeout: 0.3}}')
    assert refusal(load_parameter_file, path) == '\n'.join(
        f'{path}: {key}: found {values}, wanted one value for both, or the namespace of a robot'
        for key, values in {
            'final_time': '6.0 for /r2/** and 7.0 for /r1/**',
            'odom_timeout': '0.2 for /r1/guidance and 0.3 for /r1/**',
        }.items()
    )
    own = load_parameter_file(path, namespace='/r1')
    assert own == {'final_time': 7.0, 'odom_timeout': 0.3}
    assert load_parameter_file(path, namespace='/r2')['final_time'] == 6.0


def test_a_section_for_all_nodes_of_the_only_robot_contradicts_none(tmp_path):
    path = tmp_path / 'one.yaml'
    path.write_text(f'/r1/**:\n  ros__parameters: {{final_time: 5.0}}\n{MERGED}')
    assert load_parameter_file(path)['final_time'] == 6.0


def test_robots_written_load_bit_for_bit(tmp_path):
    path = tmp_path / 'written.yaml'
    robots = {'/r1': {'final_time': 0.1 + 0.2}, '/r2': {'final_time': 5.0, 'noise.seed': 3}}
    write_fleet_file(path, robots)
    assert robots_in(path) == ('/r1', '/r2')
    for namespace, values in robots.items():
        assert load_parameter_file(path, namespace=namespace) == values


def test_a_file_for_other_nodes_is_refused(tmp_path):
    path = tmp_path / 'other.yaml'
    path.write_text('camera:\n  ros__parameters: {gain: 1}')
    assert 'found sections for /camera only' in refusal(load_parameter_file, path)


def test_a_preset_misspelt():
    message = refusal(load_parameter_file, 'case33')
    assert message.startswith("'case33': found no such preset, wanted a preset (")
    assert 'case1, case2, ' in message
    assert message.endswith('(did you mean case3?)')


def test_files_that_cannot_be_read(tmp_path):
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(b'\xff\xfe\xfd')
    assert 'found No such file' in refusal(load_parameter_file, tmp_path / 'none.yaml')
    assert 'found Is a directory' in refusal(load_parameter_file, tmp_path)
    assert "codec can't decode" in refusal(load_parameter_file, binary)
    assert 'null byte' in refusal(load_parameter_file, 'a\0.yaml')


@pytest.mark.parametrize(
    ('text', 'key', 'value'),
    [
        ('weights.road_center=30', 'weights.road_center', 30),
        (' goal.tolerance = 1e-3', 'goal.tolerance', 1e-3),
        ('goal.position=[10, 0]', 'goal.position', [10, 0]),
        ('obstacles.names=[a, b]', 'obstacles.names', ['a', 'b']),
        ('frame_id="a=b"', 'frame_id', 'a=b'),
        ('robot.footprint="[[0, 1]]"', 'robot.footprint', '[[0, 1]]'),
    ],
)
def test_assignments(text, key, value):
    assert parse_assignment(text) == (key, value)


@pytest.mark.parametrize('text', ['', 'a', '=1', 'a=', 'a={b: 1}', 'a=[', 'a=: :'])
def test_what_is_no_assignment_is_refused(text):
    assert 'wanted' in refusal(parse_assignment, text)


def test_a_place_that_cannot_be_written_to(tmp_path):
    assert 'No such file' in refusal(write_parameter_file, tmp_path / 'none' / 'a.yaml', {})


FINITE = st.floats(allow_nan=False, allow_infinity=False)
POSITIVE = st.floats(0.0, exclude_min=True, allow_infinity=False)


@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    position=st.tuples(FINITE, FINITE),
    tolerance=POSITIVE,
    seed=st.integers(0, 2**63 - 1),
    frame=st.text(min_size=1).filter(lambda text: text.isprintable() and text.strip()),
    radii=st.dictionaries(st.from_regex(r'[a-z]{1,3}', fullmatch=True), POSITIVE, max_size=3),
)
def test_a_set_written_loads_bit_for_bit(tmp_path, position, tolerance, seed, frame, radii):
    chosen = {'goal.position': position, 'goal.tolerance': tolerance, 'noise.seed': seed}
    for name, radius in radii.items():
        chosen[f'obstacles.{name}.center'] = position
        chosen[f'obstacles.{name}.radius'] = radius
    values = TABLE.resolve({**chosen, 'frame_id': frame, 'obstacles.names': list(radii)})
    path = tmp_path / 'set.yaml'
    write_parameter_file(path, values)
    assert repr(TABLE.resolve(load_parameter_file(path))) == repr(values)


@pytest.mark.parametrize(
    'package', ['lib/python3.11/site-packages', 'install/cmpsp_ros/lib/python3.12/site-packages']
)
def test_presets_are_found_where_an_installation_puts_them(tmp_path, package):
    module = tmp_path / package / 'cmpsp_ros' / 'parameters' / 'presets.py'
    module.parent.mkdir(parents=True)
    prefix = (tmp_path / package).parents[2]
    message = refusal(config_directory, module)
    assert 'found no folder of presets above' in message
    shutil.copytree(Path(__file__).parents[3] / 'config', prefix / 'share/cmpsp_ros/config')
    assert config_directory(module) == prefix / 'share' / 'cmpsp_ros' / 'config'


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


def robots_page():
    return (config_directory().parent / 'doc' / 'user' / 'robots.md').read_text(encoding='utf-8')


def robot_refusal(path_or_name):
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
    said = {key.removeprefix('robot.'): value for key, value in given.items()}
    wheel, track, radius = (said[key] for key in ('wheel_radius', 'half_track', 'radius'))
    assert f'| `{name}` | {wheel} m | {track} m | {speed} m/s | {radius} m |' in robots_page()


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
    speed, base, angle = CARS[name]
    radius = settings.robot_radius
    assert f'| `{name}` | {base} m | {angle} rad | {speed} m/s | {radius} m |' in robots_page()


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
    message = robot_refusal('turtlebot3_burgr')
    assert message.startswith("'turtlebot3_burgr': found no such robot, wanted a robot (car, ")
    assert message.endswith('(did you mean turtlebot3_burger?)')


def test_a_robot_of_the_user(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('/**:\n  ros__parameters:\n    robot: {wheel_radius: 0.05}\n')
    assert load_robot(str(path)) == {'robot.wheel_radius': 0.05}
    path.write_text('/**:\n  ros__parameters:\n    command_delay: 0.1\n    max_wheel_lag: 0.2\n')
    assert load_robot(str(path)) == {'command_delay': 0.1, 'max_wheel_lag': 0.2}
    path.write_text('/**:\n  ros__parameters:\n    robot: {radius: 0.1}\n    final_time: 3.0\n')
    assert 'found final_time in the file of a robot, wanted only robot.*' in robot_refusal(path)
    assert 'No such file' in robot_refusal(tmp_path / 'none.yaml')
