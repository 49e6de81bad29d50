"""Pictures of runs: what they name, what they show whole, and what lies above what."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bag_messages import PLAIN_DECISION, SECOND, cloud, joints, odometry, status, write_bag
from matplotlib.patches import Circle

from cmpsp_ros.bags.runs import read_run
from cmpsp_ros.demo import load_scenario
from cmpsp_ros.demo.results import draw_controls, draw_fleet, draw_trajectory
from cmpsp_ros.demo.summary import summarise
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.sensing import Track

LENGTH = 2.0


@pytest.fixture
def driven(tmp_path):
    """A scenario and a run at a constant twist from its start: `driven(preset, twist)`."""

    def made(preset, motion=(0.3, 0.0), namespace='', *, people=False):
        lockstep = not namespace
        scenario = load_scenario(preset, [], lockstep=lockstep, namespace=namespace)
        settings = replace(scenario.settings, final_time=LENGTH)
        path = tmp_path / f'{preset}{namespace.replace("/", "_")}'
        stamps = np.arange(0, round(LENGTH * SECOND) + 1, SECOND // 50)
        twists = np.tile(motion, (len(stamps), 1))
        starts = np.tile(scenario.values['initial_pose'], (len(stamps), 1))
        wheels = settings.robot.wheel_speeds(np.array(motion))
        poses = arc_ends(starts, twists, stamps / SECOND)
        records = [('guidance/decision', 0, status(**PLAIN_DECISION, stamp=0))]
        for stamp, pose in zip(stamps.tolist(), poses.tolist(), strict=True):
            records.append(('sim/truth', stamp, odometry(stamp, pose, motion)))
            records.append(('sim/wheel_speeds', stamp, joints(stamp, tuple(wheels.tolist()))))
        for topic, number in (('sim/people', 0), ('guidance/tracks', Track.SEEN + 1)):
            for stamp in stamps[::10].tolist() if people else ():
                walked = cloud(stamp, [(number, 1.0, 2.0 - stamp / SECOND, 0.0, -1.0, 0.25)])
                records.append((topic, stamp, walked))
        write_bag(path, [(f'{namespace}/{topic}', *rest) for topic, *rest in records])
        return replace(scenario, settings=settings), read_run(path, namespace)

    return made


def labels(axes):
    return axes.get_legend_handles_labels()[1]


@pytest.mark.parametrize('preset', ['omni_aisle', 'clutter', 'case3'])
def test_the_legend_is_below_the_axis_and_names_what_is_there(driven, tmp_path, preset):
    scenario, run = driven(preset, (0.3, 0.0, 0.0) if preset == 'omni_aisle' else (0.3, 0.0))
    figure = draw_trajectory(run, scenario.settings, tmp_path / 'path.png', scenario.hidden)
    (axes,), (legend,) = figure.axes, figure.legends
    assert legend.get_window_extent().y1 < axes.xaxis.label.get_window_extent().y0
    named = set(labels(axes))
    assert ('road' in named) == (preset != 'clutter')
    assert ('obstacle that only the simulator knows' in named) == (preset == 'clutter')
    assert ('obstacle' in named) == (preset != 'clutter')
    assert {'start and end', 'driven', 'goal'} <= named
    assert ('outline of the robot' in named) == (preset != 'case3')


def test_people_are_drawn_where_they_were_nearest_and_their_clearance_counts(driven, tmp_path):
    scenario, run = driven('clutter', people=True)
    figure = draw_trajectory(run, scenario.settings, tmp_path / 'path.png')
    assert {'person where nearest', 'track of a moving obstacle'} <= set(labels(figure.axes[0]))
    (disc,) = (each for each in figure.axes[0].patches if isinstance(each, Circle))
    assert disc.center == pytest.approx((1.0, 0.0), abs=0.05)
    assert run.told == ()
    away = float(np.hypot(0.4, 0.02)) - 0.25 - scenario.settings.robot_radius
    assert summarise(run, scenario.settings, 'clutter').clearance == pytest.approx(away, abs=0.05)


def test_shapes_at_the_border_are_shown_whole(driven, tmp_path):
    scenario, run = driven('clutter')
    figure = draw_trajectory(run, scenario.settings, tmp_path / 'path.png', scenario.hidden)
    low, high = np.array([figure.axes[0].get_xlim(), figure.axes[0].get_ylim()]).T
    for shape in scenario.hidden:
        reach = max(shape.radius, 0.0)
        corners = np.array(shape.corners)
        first, last = corners.min(axis=0) - reach, corners.max(axis=0) + reach
        inside = (first > low).all() and (last < high).all()
        beyond = (first > high).any() or (last < low).any()
        assert inside or beyond, shape.name


def test_a_car_is_drawn_with_its_footprint_speed_and_steering(driven, tmp_path):
    speed, angle = 0.3, -0.2
    scenario, run = driven('parking', (speed, speed * math.tan(angle) / 0.3302))
    figure = draw_controls(run, scenario.settings, tmp_path / 'controls.png')
    assert [each.get_ylabel() for each in figure.axes] == ['speed [m/s]', 'steering angle [rad]']
    for axes, value, limit in zip(figure.axes, (speed, angle), (1.5, 0.4189), strict=True):
        curve, mark, *_ = axes.lines
        np.testing.assert_allclose(curve.get_ydata(), value)
        assert mark.get_ydata()[0] == limit
    path = draw_trajectory(run, scenario.settings, tmp_path / 'path.png')
    (body,) = (each for each in path.axes[0].lines if each.get_label() == 'outline of the robot')
    corners = body.get_xydata()
    for corner in ((0.4615, 0.155), (-0.1186, -0.155)):
        assert np.nanmin(np.hypot(*(corners - corner).T)) < 1e-6


def test_every_wheel_of_an_omnidirectional_robot_has_its_speed(driven, tmp_path):
    scenario, run = driven('omni_aisle', (0.2, 0.1, 0.0))
    (axes,) = draw_controls(run, scenario.settings, tmp_path / 'controls.png').axes
    assert axes.get_ylabel() == 'wheel speed [rad/s]'
    assert [name for name in labels(axes) if 'wheel' in name] == [
        'front left wheel', 'front right wheel', 'rear right wheel', 'rear left wheel',
    ]  # fmt: skip
    wanted = scenario.settings.robot.wheel_speeds(np.array([0.2, 0.1, 0.0]))
    np.testing.assert_allclose([each.get_ydata()[0] for each in axes.lines[:4]], wanted)


def test_the_start_of_each_robot_of_a_fleet_is_above_all_goals(driven, tmp_path):
    fleet, runs = zip(*(driven('fleet', (0.5, 0.0), each) for each in ('/r1', '/r2')), strict=True)
    (axes,) = draw_fleet(fleet, runs, tmp_path / 'fleet.png').axes
    stars = [each for each in axes.lines if each.get_marker() == '*']
    ends = [each for each in axes.lines if isinstance(each.get_marker(), tuple)]
    starts = {tuple(np.round(each.get_xydata()[0], 6)): each for each in ends}
    for scenario in fleet:
        start = starts[tuple(scenario.values['initial_pose'][:2])]
        assert all(start.get_zorder() > each.get_zorder() for each in stars)
    # One robot's goal is another one's start: it is to be seen through the star.
    assert {each.get_markerfacecolor() for each in stars} == {'none'}
