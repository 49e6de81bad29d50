"""Targets of the study: the ten runs of Cases 1 to 3 and Tables 1 and 2, and the obstacles."""

from functools import cache

import numpy as np
import pytest

from cmpsp_ros.studies.paper import table1, table2
from cmpsp_ros.studies.paper.drives import TOUCHED, Path, guessed_path, run_law, spans
from cmpsp_ros.studies.paper.experiments import case3_at_45, cases, few_obstacles, many_obstacles
from cmpsp_ros.studies.paper.iterations import Recipe, follow

TEN = {each.key: each for each in (*cases(), *table1(), *table2())}
OTHERS = {each.key: each for each in (case3_at_45(), *few_obstacles(), *many_obstacles())}
ALL = {**TEN, **OTHERS}


@cache
def driven(key, between_samples):
    return run_law(ALL[key], between_samples=between_samples).path


def swept(path):
    """Least clearance of many points on the path, by nothing but distances."""
    settings = path.settings
    fine = np.repeat(path.controls, 50, axis=0)
    durations = np.full(len(fine), settings.control_period / 50)
    points = settings.robot.roll_out(path.poses[0], fine, durations)[:, :2]
    radius = np.linalg.norm(points - settings.road.center, axis=1)
    parts = [settings.road.outer_radius - radius, radius - settings.road.inner_radius]
    parts += [
        np.linalg.norm(points - each.center, axis=1) - each.radius for each in settings.obstacles
    ]
    return float(np.min(parts))


@pytest.mark.parametrize('key', ALL)
def test_with_the_bound_it_arrives_and_touches_nothing(key):
    path = driven(key, True)
    assert len(path.controls) == 50
    assert path.miss < 1e-6
    assert path.clearance(between_samples=True).min() >= 0.0
    assert swept(path) >= 0.0
    assert np.abs(path.controls).max() <= path.settings.robot.max_wheel_speed


@pytest.mark.parametrize('key', ALL)
def test_as_the_paper_has_it_it_arrives_and_is_clear_at_the_samples(key):
    path = driven(key, False)
    assert path.miss < 1e-6
    assert path.clearance(between_samples=False).min() >= TOUCHED
    assert np.abs(path.controls).max() <= path.settings.robot.max_wheel_speed


def test_samples_alone_let_the_path_cut_obstacles():
    between = [driven(key, False).clearance(between_samples=True).min() for key in TEN]
    assert -0.05 < min(between) < -1e-3


@pytest.mark.parametrize('key', ['case3', 'table2_1', 'five_obstacles'])
@pytest.mark.parametrize('between_samples', [False, True])
def test_the_measured_clearance_is_that_of_many_points(key, between_samples):
    path = driven(key, between_samples)
    assert path.clearance(between_samples=True).min() == pytest.approx(swept(path), abs=1e-4)


def test_case_2_peaks_near_the_papers():
    peaks = np.abs(driven('case2', False).controls).max(axis=0)
    assert peaks.max() == pytest.approx(52.7, abs=1.0)


def test_the_text_alone_makes_cases_1_to_3_and_fails_most_of_the_tables():
    arrived = [key for key, each in TEN.items() if follow(each, Recipe.AS_WRITTEN).miss < 1e-6]
    assert arrived[:3] == ['case1', 'case2', 'case3']
    assert len(arrived) < 7


def test_obstacles_come_one_after_the_other():
    counts = [len(each.settings.obstacles) for each in (*few_obstacles(), *many_obstacles())]
    assert counts == [0, 1, 2, 3, 4, 5]
    five = many_obstacles()[-1].settings.obstacles
    for each in (*few_obstacles(), *many_obstacles()):
        assert set(each.settings.obstacles) <= set(five)


def test_the_guess_of_the_obstacle_runs_is_a_straight_line():
    path = guessed_path(few_obstacles()[0])
    np.testing.assert_array_equal(path.poses[:, 1:], np.tile([-9.25, 0.0], (51, 1)))


@pytest.mark.parametrize('between_samples', [False, True])
@pytest.mark.parametrize('each', [*few_obstacles(), *many_obstacles()], ids=lambda e: e.key)
def test_an_independent_solver_finds_every_layout_feasible(each, between_samples):
    pytest.importorskip('casadi')
    from cmpsp_ros.guidance.planning import along_road
    from cmpsp_ros.guidance.prediction import PlanStart
    from cmpsp_ros.studies.paper import reference_solution

    settings, pose = each.with_bound(between_samples), np.array(each.pose)
    start = PlanStart(pose, settings.robot, settings.world)
    guess = along_road(settings, start, settings.target, np.full(50, 0.2))[:-1]
    found = reference_solution(settings, pose, Path.open_loop(settings, pose, guess))
    assert found.feasible, found.status
    # Its own word is not taken for it.
    path = Path.open_loop(settings, pose, found.controls)
    assert path.miss < 1e-6
    assert path.clearance(between_samples=False).min() > -1e-6
    assert np.abs(path.controls).max() < settings.robot.max_wheel_speed + 1e-6
    if between_samples:
        assert swept(path) > 0.0
        assert path.cost <= driven(each.key, True).cost + 1e-6


def test_judge_says_when_there_is_no_way():
    pytest.importorskip('casadi')
    from dataclasses import replace

    from cmpsp_ros.studies.paper import reference_solution
    from cmpsp_ros.world.obstacles import Obstacle

    settings = replace(cases()[0].settings, obstacles=(Obstacle('wall', (7.0, -7.0), 1.5),))
    path = guessed_path(few_obstacles()[0])
    assert not reference_solution(settings, np.array(cases()[0].pose), path).feasible


@pytest.mark.parametrize(
    ('flags', 'count'), [('', 0), ('0', 0), ('1', 1), ('0110', 1), ('1011', 2), ('10101', 3)]
)
def test_spans(flags, count):
    assert spans(np.array([flag == '1' for flag in flags], dtype=bool)) == count
