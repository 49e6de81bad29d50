"""Sets of parameters that contradict themselves: the key, what was found and what was wanted."""

import pytest
from given_courses import BEND, CAR, MECANUM, SQUARE, THREE, WAYPOINTS

from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    guidance_settings,
    laser_settings,
    plant_settings,
)

DISC = {'obstacles.names': ['a'], 'obstacles.a.center': [10.0, 0.5], 'obstacles.a.radius': 0.4}
FOLLOWED = {'follow.speed': 1.0}
SCANNER = {'sim.scan.rate': 10.0}
WALKER = {'sim.people.names': ['ann'], 'initial_pose': [0.0, -9.25, 0.0]}
CORNERS = 'wanted corners around the robot'


def shape(kind, **block):
    given = {f'obstacles.a.{key}': value for key, value in block.items()}
    return {'obstacles.names': ['a'], 'obstacles.a.type': kind, **given}


def refused(check, given, said):
    with pytest.raises(ParameterError, match=said):
        check(TABLE.resolve(given))


GUIDANCE = [
    ({'command_delay': 9.9}, 'command_delay: found 9.9 s, wanted at most final_time - control_per'),
    ({'final_time': 0.1}, 'final_time: found 0.1 s, wanted at least control_period = 0.2 s'),
    ({'final_time': 1e9}, 'final_time: found .*, wanted at most 10000 times control_period'),
    ({'robot.half_track': 1e-300}, 'robot.half_track: found 1e-300, wanted 1e-06 or more'),
    ({'robot.max_wheel_speed': 1e-9}, 'robot.max_wheel_speed: found 1e-09 rad/s, wanted 1e-06'),
    ({'others.namespaces': ['/r1', 'r2']}, r'others.namespaces: found .*r2.* robots, as in /r1'),
    # Roads, and goals on them.
    ({'road.inner_radius': 11.0}, 'road.inner_radius: found 11.0 m, wanted less than road.outer_r'),
    ({'robot.radius': 0.4, 'safety.margin': 0.6},
     'road.inner_radius, road.outer_radius: found .* half width 1 m, wanted more than robot.rad'),
    ({'goal.position': [1e300, 0.0]}, r'goal.position: found \[1e\+300.*no number beyond 1e\+09'),
    ({'goal.position': [10.8, 0.0], 'robot.radius': 0.25},
     'goal.position: found 0.05 m inside or beyond the outer road edge, wanted .* robot.radius'),
    (DISC | {'robot.radius': 0.2}, 'goal.position: found 0.1 m inside or beyond obstacle a'),
    (BEND | {'road.points': []}, 'road.points: found .*, wanted x and y of each point'),
    (BEND | {'road.points': [0.0, 0.0, 1.0]}, 'road.points: found .*, wanted x and y of each'),
    (BEND | {'road.points': [0.0, 0.0]}, 'at point 1 .*, wanted 2 points or more'),
    (BEND | {'road.points': [0.0] * 4}, r'at point 1 \(from 0\) the same place'),
    (BEND | {'road.points': [0.0, 0.0, 3.0, 0.0, 1.0, 0.0]}, 'at point 1 .* turn back by 180 deg'),
    (BEND | {'road.half_width': [0.5, 0.5]}, 'road.half_width: found 2 widths, wanted one, or one'),
    (BEND | {'road.right_width': [0.5, 0.5]}, 'road.right_width: found 2 widths, wanted one, or'),
    (BEND | {'road.half_width': [0.5, 0.0, 0.5, 0.5]}, 'road.half_width: found .* numbers > 0'),
    (BEND | {'road.half_width': [9.0]}, 'point .* a curve of radius .* m after it'),
    (BEND | {'road.half_width': [0.5, 0.2, 0.5, 0.5], 'robot.radius': 0.2},
     'found 0.2 m to the left of point 1, wanted more than robot.radius'),
    (BEND | {'goal.position': [3.0, 1.5]}, 'goal.position: found .* beyond the left road edge'),
    (BEND | {'goal.position': [8.5, 3.5]}, 'goal.position: found .* beyond the end of the road'),
    (BEND | {'robot.footprint': '[[-2, -2], [2, -2], [2, 2], [-2, 2]]'},
     'road.half_width.* radius of the discs of'),
    # Several goals, and roads without end.
    (WAYPOINTS | {'waypoints.a.position': [7.0, -4.0]},
     'waypoints.a.position: found 0.938 m inside or beyond the inner road edge'),
    (WAYPOINTS | {'waypoints.a.time': 0.1}, 'a.time: found 0.1 s, wanted 0 . control_period'),
    (WAYPOINTS | {'waypoints.b.time': 4.1}, 'b.time: found 4.1 s, wanted waypoints.a.time .'),
    (WAYPOINTS | {'final_time': 8.0}, 'final_time: found 8.0 s, wanted waypoints.b.time . control'),
    (WAYPOINTS | {'final_time': 0.0}, 'final_time: found 0.0 s'),
    ({'goal.heading': [1.0, 2.0]}, r'goal.heading: found \[1.0, 2.0\], wanted a list of one'),
    ({'goal.nominal_speed': 2.0}, 'goal.nominal_speed: found 2.0 m/s, wanted at most'),
    (WAYPOINTS | FOLLOWED, r"waypoints.names: found \['a', 'b'\], wanted none"),
    ({'follow.speed': 1.8}, 'follow.speed: found 1.8 m/s, wanted at most'),
    (FOLLOWED | {'follow.horizon': 0.3}, 'follow.horizon: found 0.3 s, wanted 2 to 1000 times'),
    (FOLLOWED | {'follow.horizon': 40.0}, 'follow.horizon: found 40 m of way .*, wanted less than'),
    (FOLLOWED | {'road.type': 'none'}, 'follow.speed: found 1.0 m/s, wanted 0 on a road with an'),
    (FOLLOWED | {'road.type': 'corridor', 'road.points': [0.0, 0.0, 9.0, 0.0]},
     'follow.speed: found 1.0 m/s, wanted 0 on a road with an end'),
    # Robots.
    ({'robot.model': 'tank'}, "robot.model: found 'tank', wanted .*mecanum"),
    ({'robot.joint_names': ['a']}, 'robot.joint_names'),
    (MECANUM | {'robot.half_wheel_base': 0.0}, 'robot.half_wheel_base'),
    (MECANUM | {'robot.joint_names': ['a', 'b']}, 'robot.joint_names'),
    (MECANUM | {'initial_guess.type': 'constant'}, 'initial_guess.type'),
    (MECANUM | {'plant': 'mujoco'}, 'plant'),
    (THREE | {'robot.wheel_bearings': [0.0, 1.0], 'robot.joint_names': ['a', 'b']}, 'bearings'),
    (THREE | {'robot.wheel_bearings': [1.0, 1.0, 1.0]}, 'robot.wheel_bearings'),
    # Wheels that all roll the same way, or against it, never move the robot aside.
    (THREE | {'robot.wheel_bearings': [0.0, 3.141592653589793, 0.0]}, 'robot.wheel_bearings'),
    (CAR | {'robot.wheel_base': 0.0}, 'robot.wheel_base'),
    (CAR | {'robot.max_steering_angle': 0.0}, 'robot.max_steering_angle'),
    (CAR | {'robot.max_steering_angle': -0.1}, 'robot.max_steering_angle'),
    (CAR | {'robot.max_steering_angle': 1.6}, 'robot.max_steering_angle'),
    (CAR | {'robot.max_steering_rate': 0.4}, 'robot.max_wheel_acceleration'),
    (CAR | {'goal.hold': True}, 'goal.hold'),
]  # fmt: skip


@pytest.mark.parametrize(('changes', 'said'), GUIDANCE)
def test_settings_of_the_guidance(changes, said):
    refused(guidance_settings, changes, said)


SHAPES = [
    (shape('circle'), r'a.center: found nothing, wanted a list of 2 .*\n.*a.radius: found nothing'),
    (
        shape('circle', center=[8, -6], radius=0.7, end=[1, 2]),
        'a.end: found .*nothing with type circle',
    ),
    (shape('capsule', start=[8, -6], end=[9], radius=0.1), 'a.end: found .* a list of 2 numbers'),
    (
        shape('polygon', vertices=SQUARE[:5]),
        'a.vertices: found .* wanted x and y .* of each vertex',
    ),
    (
        shape('polygon', vertices=SQUARE, radius=0.1),
        'a.radius: found 0.1, wanted nothing with type pol',
    ),
    (
        shape('polygon', vertices=[*SQUARE, 9.9, -2.5]),
        r'a.vertices: found at vertex 4 \(from 0\) a',
    ),
]
FOOTPRINTS = [
    ('round', f"found 'round', {CORNERS}"),
    ('[[0.1, 0.2], [0.3', CORNERS),
    ('[[0.1, 0.2, 0.3], [1, 1], [0, 1]]', CORNERS),
    ('[[0.1, "a"], [1, 1], [0, 1]]', CORNERS),
    ('[[True, 1], [1, 1], [0, 1]]', CORNERS),
    ('[[1e999, 0.1], [-1, 1], [-1, -1]]', CORNERS),
    ('[[nan, 0.1], [-1, 1], [-1, -1]]', CORNERS),
    (f'[[1{"0" * 400}, 0.1], [-1, 1], [-1, -1]]', CORNERS),
    ('[' * 5000, CORNERS),
    ('[]', 'found 0 corners, wanted three or more'),
    ('[[1, 1], [-1, -1]]', 'found 2 corners, wanted three or more'),
    ('[[-1, -1], [1, 1], [1, -1], [-1, 1]]', 'found sides that cross, from corners 0 and 2'),
    ('[[-1, -1], [1, -1], [0, 1], [0, -1]]', 'found sides that cross, from corners 0 and 2'),
    ('[[-1, -1], [2, -1], [1, -1], [0, 1]]', 'found sides that cross, from corners 0 and 1'),
    ('[[-1, -1], [1, -1], [1, -1], [0, 1]]', r'corner 2 \(from 0\) at the place of the one'),
    ('[[-1, 0], [0, 0.0], [1, 0]]', 'found sides that cross'),
    ('[[1, -1], [2, -1], [1.5, 1]]', r'found corners that do not go around \[0, 0\]'),
]


@pytest.mark.parametrize('check', [guidance_settings, check_simulation])
@pytest.mark.parametrize(
    ('given', 'said'),
    [
        *SHAPES,
        *(({'road.type': 'none', 'robot.footprint': text}, f'^robot.footprint: .*{said}')
          for text, said in FOOTPRINTS),
    ],
)  # fmt: skip
def test_obstacles_and_footprints_of_either_node(check, given, said):
    refused(check, given, said)


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ({'initial_pose': [0.0, -8.0, 0.0]}, 'initial_pose: found 1 m .* the inner road edge'),
        (DISC | {'initial_pose': [10.0, 0.75, 0.0], 'robot.radius': 0.1},
         'initial_pose: found 0.25 m inside or beyond obstacle a, wanted .* robot.radius'),
        ({**WALKER, 'sim.people.ann.position': [0.0, -9.3]},
         r'ann.position: found 0.2 m inside the robot \(initial_pose\), wanted .* ann has room'),
        (DISC | WALKER | {'sim.people.ann.position': [10.0, 1.0]},
         'ann.position: found 0.15 m inside obstacle a, wanted a place where ann has room'),
        (DISC | WALKER | {'sim.people.ann.position': [10.0, -0.4], 'sim.people.ann.count': 2},
         'ann.position: found 0.45 m inside obstacle a, wanted a place where ann has room'),
        ({**WALKER, 'robot.footprint': '[[-0.2, -0.2], [1, -0.2], [1, 0.2], [-0.2, 0.2]]',
          'sim.people.ann.position': [0.9, -9.25]},
         r'ann.position: found .* m inside the robot \(initial_pose\)'),
        (WALKER | {'sim.people.names': ['legs']},
         "sim.people.names: found 'legs', wanted another name: sim.people.legs is a parameter"),
        (BEND | {'initial_pose': [1.0, -1.2, 0.0]}, 'initial_pose: found .* the right road edge'),
        (BEND | {'initial_pose': [-0.5, 0.0, 0.0]}, r'initial_pose: found 0.499\d* m beyond'),
        (WAYPOINTS | {'waypoints.a.time': 4.1, 'lockstep': True}, 'a.time: found 4.1 .* multiple'),
        ({'odom_rate': 25.0, 'odom_jitter': 0.05}, 'odom_jitter: found 0.05 s, wanted less than'),
        ({'odom_rate': 1e-9}, 'odom_rate: found 1e-09 Hz, wanted at least 0.001 Hz'),
        ({'real_time_factor': 1e9}, 'real_time_factor: found 1000000000.0, wanted from 0.001 to'),
    ],
)  # fmt: skip
def test_settings_of_the_simulator(given, said):
    refused(check_simulation, given, said)


@pytest.mark.parametrize(
    ('given', 'said'),
    [
        ({'sim.scan.angle_min': 1.0, 'sim.scan.angle_max': 0.5},
         'sim.scan.angle_max: found 0.5 rad, wanted more than sim.scan.angle_min = 1.0 rad'),
        ({'sim.scan.range_min': 2.0, 'sim.scan.range_max': 1.0},
         'sim.scan.range_max: found 1.0 m, wanted more than sim.scan.range_min = 2.0 m'),
        ({'sim.scan.count': 11, 'sim.scan.time_increment': 0.02},
         'sim.scan.time_increment: found 0.02 s, wanted at most 0.01 s, for a scan within 1 / sim'),
        ({'sim.obstacles.names': ['wall']}, 'sim.obstacles.wall.center: found nothing, wanted a'),
    ],
)  # fmt: skip
def test_a_scanner(given, said):
    refused(laser_settings, SCANNER | given, said)


@pytest.mark.parametrize(
    'times', [[1.0], [2.0, 1.0], [1.0, 1.0], [0.0, 2.0, 1.0, 3.0], [0.0, 1.0] * 2]
)
def test_windows_without_odometry_that_are_no_pairs_in_order(times):
    said = r'noise.dropout_windows: found \[.* wanted pairs of times, each later than the one bef'
    refused(plant_settings, {'noise.dropout_windows': times}, said)


def test_all_that_is_wrong_is_said_at_once():
    given = {**DISC, 'final_time': 0.1, 'goal.position': [10.0, 0.4]}
    refused(guidance_settings, given, r'\Afinal_time: [^\n]*\ngoal.position: [^\n]*\Z')
