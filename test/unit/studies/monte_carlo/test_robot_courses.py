"""Nominal courses for other robots: in proportion, driven within all limits, and judged."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.studies.monte_carlo import Order, Study, StudyError, judging, run_study
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import GAP, WIDTH, is_open
from cmpsp_ros.studies.monte_carlo.driving import drive, farthest, outcome
from cmpsp_ros.studies.monte_carlo.judging import passed_alike
from cmpsp_ros.studies.monte_carlo.outcome import RunVerdict
from cmpsp_ros.studies.paper.ipopt import limit_excess, motion

ROBOTS = {
    'f1tenth': (),
    'car': (),
    'mecanum': ('robot.max_wheel_acceleration=20.26',),
    'turtlebot4': (),
}


def study(robot, seed=1):
    return Study('nominal', seed, assignments=ROBOTS[robot], robot=robot)


@pytest.mark.parametrize('robot', ROBOTS)
def test_courses_are_in_proportion_and_in_reach(robot):
    for number in range(30):
        task = study(robot).run(number)
        settings, obstacles = task.settings, task.scenario.obstacles
        road = settings.world.annulus
        scale = (road.outer_radius - road.inner_radius) / WIDTH
        assert settings.goal == pytest.approx((10.0 * scale, 0.0))
        assert is_open(road, obstacles, scale * GAP + 2.0 * settings.robot_radius)
        way = road.shortest_length(task.scenario.pose[:2], settings.goal)
        assert way < 0.8 * farthest(task) or settings.final_time < 10.0
        steps = settings.final_time / settings.control_period
        assert steps == pytest.approx(round(steps))


def test_only_the_nominal_study_has_courses_for_other_robots():
    with pytest.raises(StudyError, match='--robot: found study floor'):
        Study('floor', robot='car').values()
    with pytest.raises(StudyError, match=r'robot\.max_wheel_speed: found 0'):
        Study('nominal', robot='car', assignments=('robot.max_wheel_speed=0.0',)).values()
    command = study('mecanum').command(3)
    assert '--robot mecanum' in command
    assert '--set robot.max_wheel_acceleration=20.26' in command


@pytest.mark.parametrize('robot', ROBOTS)
def test_the_judge_knows_how_each_robot_moves(robot):
    casadi = pytest.importorskip('casadi')
    settings = study(robot).run(0).settings
    random = np.random.default_rng(1)
    model = settings.robot
    for _ in range(20):
        most = np.minimum(model.bounds, 0.7)
        control, heading = random.uniform(-most, most), float(random.uniform(-3.0, 3.0))
        pose = np.array([0.0, 0.0, heading])
        found = np.array(casadi.DM(motion(casadi, model, heading, control.tolist(), 0.2))).ravel()
        wanted = model.roll_out(pose, control[None], np.array([0.2]))[-1] - pose
        np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_what_is_beyond_a_limit_is_found():
    settings = study('f1tenth').run(0).settings
    robot = settings.robot
    steps = np.array([[0.5, 0.4], [1.0, 0.41]])
    assert limit_excess(robot, steps, 0.2) <= 0.0
    assert limit_excess(robot, np.add(steps, [0.01, 0.0]), 0.2) == pytest.approx(0.01)
    assert limit_excess(robot, np.add(steps, [0.0, 0.01]), 0.2) == pytest.approx(0.0011, abs=1e-4)
    slow = replace(robot, max_steering_rate=1.0)
    assert limit_excess(slow, steps, 0.2) == pytest.approx(0.2)


@pytest.mark.parametrize('robot', ['f1tenth', pytest.param('mecanum', marks=pytest.mark.slow)])
def test_a_run_keeps_every_limit(robot):
    task = study(robot).run(3)
    driven = drive(task)
    made = outcome(driven)
    assert made.verdict(1e-3) == RunVerdict.ARRIVED
    assert made.over_limit == 0
    settings = task.settings
    assert limit_excess(settings.robot, driven.controls, settings.control_period) < 1e-6
    # A robot that could not do as much would have broken its limits.
    weaker = replace(settings.robot, max_wheel_acceleration=0.9 * 2.5)
    weak = replace(task, settings=replace(settings, robot=weaker))
    assert outcome(replace(driven, task=weak)).verdict(1e-3) == RunVerdict.OVER_LIMIT


@pytest.mark.parametrize('number', [77, 114])
def test_a_car_comes_to_its_goal_slowly_enough_to_stop_behind_it(number):
    made = outcome(drive(study('car').run(number)))
    assert made.verdict(1e-3) == RunVerdict.ARRIVED
    assert made.stop == 0


def test_the_judge_brakes_a_car_to_rest():
    pytest.importorskip('casadi')
    task = study('f1tenth').run(2)
    found = judging.judge_failure(task)
    assert found['answer'] == judging.FEASIBLE


def test_sides_of_a_point():
    ahead = np.column_stack([np.linspace(0.0, 2.0, 20), np.zeros(20)])
    over = ahead + np.column_stack([np.zeros(20), np.sin(np.linspace(0.0, math.pi, 20))])
    assert passed_alike(ahead, over, np.array([1.0, -0.5]))
    assert not passed_alike(ahead, over, np.array([1.0, 0.5]))


@pytest.mark.slow
@pytest.mark.parametrize('robot', ROBOTS)
def test_of_forty_robots_those_arrive_that_can(robot, tmp_path):
    """All but one full-size car, which steers slowly."""
    order = Order(study(robot, 7), 40, tmp_path / robot, judge=True)
    values = run_study(order, lambda *_: lambda _: None)
    (folder,) = tmp_path.iterdir()
    assert json.loads((folder / 'summary.json').read_text()) == json.loads(json.dumps(values))
    answers = [each['judge']['answer'] for each in values['failures']]
    assert len(answers) - answers.count(judging.NOT_FOUND) <= (robot == 'car')
    counts = {name: each['count'] for name, each in values['shares'].items()}
    assert counts['touched an obstacle, of runs with any'] == counts['left the road'] == 0
    assert counts['commands changed or steered too much'] == 0


@pytest.mark.slow
@pytest.mark.parametrize('robot', ['mecanum', 'turtlebot4'])
def test_a_plan_that_may_change_quickly_costs_little_more_than_the_least(robot, tmp_path):
    quick = *ROBOTS[robot], 'weights.control_change=0.0001'
    order = Order(Study('nominal', 7, assignments=quick, robot=robot), 10, tmp_path, costs=10)
    costs = run_study(order, lambda *_: lambda _: None)['costs']
    assert costs['at_most_5_percent_more'] >= 0.8 * costs['of_the_same_class'] > 0
