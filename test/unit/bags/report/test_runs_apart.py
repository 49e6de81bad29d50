"""Each run on its own course, with its robot as it is, and with what only others know."""

import math

import numpy as np
import pytest
from bag_messages import SECOND, cloud, grid, odometry, twist, write_bag

from cmpsp_ros.bags.audit import Sources, read_record
from cmpsp_ros.bags.report.charts import clearance, controls
from cmpsp_ros.bags.report.page import summary
from cmpsp_ros.bags.report.path_chart import moving, path
from cmpsp_ros.bags.report.picture import draw_report
from cmpsp_ros.bags.report.view import view
from cmpsp_ros.parameters import TABLE, load_parameter_file
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.sensing import Track

LENGTH = 2.0
FLOOR = {
    'road.type': 'none',
    'initial_pose': [0.0, 0.0, 0.0],
    'goal.position': [3.0, 0.0],
    'robot.radius': 0.2,
}


def rows(start, motion):
    """Odometry of a robot that goes on as it began."""
    seconds = np.arange(0.0, LENGTH + 1e-9, 0.02)
    poses = arc_ends(np.tile(start, (len(seconds), 1)), np.tile(motion, (len(seconds), 1)), seconds)
    return zip((seconds * SECOND).round().astype(int).tolist(), poses.tolist(), strict=True)


@pytest.fixture
def seen(tmp_path):
    """The view of a run at a constant twist: `seen(name, parameters, twist=..., others=...)`."""

    def made(name, given, motion=(0.5, 0.0), *, others=(), sim=None, cells=None, moving=()):
        given = TABLE.resolve(given)
        starts = {'/r1': (given['initial_pose'], motion), **dict(others)}
        records = [
            (f'{robot}/odom', stamp, odometry(stamp, pose, its))
            for robot, (start, its) in starts.items()
            for stamp, pose in rows(start, its)
        ]
        stamps = [round(0.2 * k * SECOND) for k in range(10)]
        records += [('/r1/cmd_vel', stamp + 1, twist(*motion)) for stamp in stamps]
        if cells is not None:
            records += [('/r1/guidance/sighting', SECOND, grid(SECOND, cells, (1.0, 1.0)))]
        for topic, walks in dict(moving).items():
            records += [(topic, each, cloud(each, walks(each / SECOND))) for each in stamps[:6]]
        parameters = {'/r1/guidance': given}
        if sim is not None:
            parameters['/r1/sim'] = TABLE.resolve({**given, **sim})
        place = write_bag(tmp_path / name, records, parameters)
        return view(place, name, read_record(place, Sources(namespace='/r1')))

    return made


def traces(figure, name):
    return [each for each in figure['data'] if each['name'] == name]


def disc(name, center, radius=0.3):
    return {
        'obstacles.names': [name],
        f'obstacles.{name}.center': list(center),
        f'obstacles.{name}.radius': radius,
    }


def test_runs_on_two_courses_have_a_panel_each_with_nothing_of_the_other(seen, tmp_path):
    near = seen('near', {**FLOOR, **disc('tree', (1.0, 1.0))})
    far = seen('far', {**FLOOR, **disc('rock', (1.0, -9.0)), 'goal.position': [3.0, -8.0]})
    again = seen('again', {**FLOOR, **disc('tree', (1.0, 1.0)), 'safety.margin': 0.1})
    figure = path([near, far, again])

    on = {each['name']: each['xaxis'] for each in figure['data']}
    assert [on[each] for each in ('near', 'far', 'again')] == ['x', 'x2', 'x']
    of_trees, of_rocks = traces(figure, 'obstacle')
    assert (of_trees['xaxis'], of_rocks['xaxis']) == ('x', 'x2')
    assert min(of_trees['y']) == pytest.approx(0.7)
    assert max(of_rocks['y']) == pytest.approx(-8.7)
    for each in figure['data']:
        heights = [value for value in each['y'] if value is not None]
        if each['xaxis'] == 'x':
            assert min(heights, default=0.0) > -2.0, each['name']
    shown = [(each['xaxis'], each['text']) for each in traces(figure, 'names')]
    assert shown == [('x', ['tree']), ('x2', ['rock'])]
    # Of several bags the legend has one entry each, and each can be switched off as a whole.
    groups = [each.get('legendgroup') for each in figure['data'] if each['name'] in on]
    assert {'bag 0', 'bag 1', 'bag 2'} <= set(groups)
    assert figure['layout']['yaxis']['range'][0] > -3.0
    assert figure['layout']['yaxis2']['range'][0] < -9.0

    draw_report([near, far, again], tmp_path / 'three.png')
    assert (tmp_path / 'three.png').read_bytes().startswith(b'\x89PNG')


def test_a_car_is_shown_with_its_speed_and_its_steering(seen):
    given = load_parameter_file('parking')
    speed, angle = 0.3, 0.2
    turn_rate = speed * math.tan(angle) / given['robot.wheel_base']
    car = seen('car', {**given, 'final_time': 2.0}, (speed, turn_rate))
    figure = controls([car])

    titles = [figure['layout'][each]['title']['text'] for each in ('yaxis', 'yaxis2')]
    assert titles == ['speed [m/s]', 'steering angle [rad]']
    fast, steered, *_ = figure['data']
    assert fast['y'] == pytest.approx([speed] * 10)
    assert steered['y'] == pytest.approx([angle] * 10)
    assert steered['yaxis'] == 'y2'
    marks = {each['text']: each['yref'] for each in figure['layout']['annotations']}
    assert marks == {'limit 1.5 m/s': 'y', 'limit 0.4189 rad': 'y2'}
    assert '<td>largest steering angle</td><td>0.2 rad</td>' in summary([car])
    assert 'rad/s' not in str(figure['data'])


def test_the_body_is_drawn_where_the_run_began_and_ended_and_goes_with_the_slider(seen):
    given = load_parameter_file('parking')
    car = seen('car', {**given, 'final_time': 2.0}, (0.4, 0.0))
    (body,) = (each for each in traces(path([car]), 'outline of the robot') if 'meta' not in each)
    corners = np.array([body['x'], body['y']], dtype=float).T
    footprint = np.array([[0.4615, 0.155], [-0.1186, -0.155]])
    for start in (0.0, 0.8):
        for corner in footprint:
            assert (
                np.hypot(*(corners - corner - [start, 0.0]).T)[~np.isnan(corners[:, 0])].min()
                < 1e-6
            )
    (bag,) = moving([car])
    xs, ys = (np.array(each, dtype=float) for each in bag['body'])
    assert (np.nanmin(xs), np.nanmax(xs)) == (-0.1186, 0.4615)
    assert (np.nanmin(ys), np.nanmax(ys)) == (-0.155, 0.155)
    (ends,) = traces(path([car]), 'start and end')
    assert sorted(ends['x']) == pytest.approx([0.0, 0.8])
    assert ends['marker']['angle'] == [90.0, 90.0]


def test_the_other_robots_of_a_fleet_are_there_with_their_clearance(seen):
    given = {**FLOOR, 'others.namespaces': ['/r1', '/r2'], 'others.radius': 0.25}
    others = {'/r2': ((2.0, 1.0, math.pi), (0.5, 0.0))}
    one = seen('fleet', given, others=others)
    (way,) = traces(path([one]), 'other robot')
    assert (2.0, 1.0) in set(zip(way['x'], way['y'], strict=True))
    (bag,) = moving([one])
    ((other),) = bag['others']
    k = other['t'].index(1.0)
    assert (other['x'][k], other['y'][k]) == pytest.approx((1.5, 1.0))
    assert max(x for x in bag['disc'][0] if x is not None) == 0.25
    (near,) = traces(clearance([one]), 'other robots')
    # They pass each other at 1 m.
    assert min(near['y']) == pytest.approx(1.0 - 0.2 - 0.25, abs=1e-3)


def test_people_are_shown_as_they_were_and_as_they_were_tracked(seen, tmp_path):
    """One walks past at 1 m/s, 1 m ahead of the robot's start, and is seen 0.1 m beside."""
    one = seen('people', FLOOR, moving={
        '/r1/sim/people': lambda t: [(0, 1.0, 1.5 - t, 0.0, -1.0, 0.25)],
        '/r1/guidance/tracks': lambda t: [(Track.SEEN + 3, 1.1, 1.5 - t, 0.0, -1.0, 0.25)],
    })  # fmt: skip
    (track,) = traces(path([one]), 'track of a moving obstacle')
    assert [track[each] for each in 'xy'] == [
        [1.1] * 6,
        pytest.approx([1.5 - 0.2 * k for k in range(6)]),
    ]
    (walked,) = traces(path([one]), 'path of a person')
    assert walked['x'][:6] == [1.0] * 6
    (named,) = (each for each in path([one])['data'] if each['name'] == 'names')
    assert named['text'] == ['1.0 s'], 'where it was nearest'
    (bag,) = moving([one])
    ((person,), (seen_as,)) = bag['people'], bag['moving']
    assert (person['y'][-1], person['vy'][-1], person['radius'][-1]) == (0.5, -1.0, 0.25)
    assert (seen_as['timeout'], person['timeout']) == pytest.approx((0.3, 1.0))
    assert seen_as['position_stddev'] == [0.0] * 6
    draw_report([one], tmp_path / 'people.png')
    assert (tmp_path / 'people.png').read_bytes().startswith(b'\x89PNG')


HIDDEN = {
    'sim.obstacles.names': ['crate'],
    'sim.obstacles.crate.center': [1.0, 1.0],
    'sim.obstacles.crate.radius': 0.3,
}


def test_what_only_simulator_and_sensors_know_has_looks_and_names_of_its_own(seen, tmp_path):
    cells = np.zeros((10, 10), np.int8)
    cells[2, 3], cells[9] = 100, -1
    run = seen('run', FLOOR, sim=HIDDEN, cells=cells)
    figure = path([run])
    assert traces(figure, 'obstacle') == []
    (crate,) = traces(figure, 'obstacle that only the simulator knows')
    assert max(crate['x']) == pytest.approx(1.3)
    for name in ('seen by sensors', 'not seen yet'):
        (key,) = traces(figure, name)
        assert key.get('showlegend', True)
    (near,) = traces(clearance([run]), 'obstacles that only the simulator knows')
    assert min(near['y']) == pytest.approx(1.0 - 0.3 - 0.2, abs=1e-3)
    drawn = draw_report([run], tmp_path / 'run.png')
    names = {text for axes in drawn.axes for text in axes.get_legend_handles_labels()[1]}
    assert {'seen by sensors', 'obstacle that only the simulator knows'} <= names
    # There is no road, no static obstacle, and nothing to be kept clear of.
    assert not names & {'road', 'obstacle', 'kept clear at samples', 'not seen yet'}
