"""Random corridors and floors: what is promised of every course, and that robots get through."""

import math

import numpy as np
import pytest

from cmpsp_ros.studies.monte_carlo import Study, judging
from cmpsp_ros.studies.monte_carlo.driving import drive, outcome
from cmpsp_ros.studies.monte_carlo.guesses import grid_path
from cmpsp_ros.studies.monte_carlo.outcome import RunVerdict
from cmpsp_ros.world import FreeSpace

KINDS = ('corridors', 'floor')


@pytest.mark.parametrize('kind', KINDS)
def test_courses_begin_and_end_clear_and_are_open(kind):
    for number in range(12):
        task = Study(kind).run(number)
        given, pose = task.settings, np.array(task.scenario.pose)
        space = FreeSpace.of(given.road, given.obstacles, given.robot_radius)
        assert space.at(np.array([pose, [*given.goal, math.nan]])).min() > given.safety.margin
        assert len(grid_path(given, pose, 0.05)) > 2
        assert len(given.obstacles) >= 1
        assert given.road.shortest_length(pose[:2], given.goal) < judging.farthest(task)


@pytest.mark.parametrize('kind', [*KINDS, 'nominal', 'sight', 'clutter'])
def test_a_course_depends_on_seed_and_number_alone(kind):
    backward = [Study(kind, 3).run(number) for number in reversed(range(3))]
    assert backward[::-1] == [Study(kind, 3).run(number) for number in range(3)]
    assert Study(kind, 4).run(0) != Study(kind, 3).run(0)


def arrived(study, numbers):
    """Those that arrived, and those that did not though the judge finds a way; none touches."""
    found, trapped = [], []
    for number in numbers:
        task = study.run(number)
        made = outcome(drive(task))
        assert made.clearance > 0.0, number
        assert not made.exception, number
        if made.verdict(study.tolerance) == RunVerdict.ARRIVED:
            found.append(number)
        elif judging.judge_failure(task)['answer'] == judging.FEASIBLE:
            trapped.append(number)
    return found, trapped


@pytest.mark.parametrize('kind', KINDS)
def test_robots_get_through(kind):
    assert arrived(Study(kind), range(8)) == (list(range(8)), [])


@pytest.mark.slow
@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('most', [4, 6])
def test_robots_get_through_all_of_forty_courses(kind, most):
    found, trapped = arrived(Study(kind, most, most_obstacles=most), range(40))
    assert trapped == []
    assert len(found) >= 39


@pytest.mark.slow
@pytest.mark.parametrize('kind', KINDS)
def test_one_plan_is_trapped_where_several_are_not(kind):
    study = Study(kind, assignments=('solver.candidates=1',))
    stopped = [outcome(drive(study.run(number))).stop > 0 for number in range(40)]
    assert sum(stopped) >= 3


@pytest.mark.parametrize('kind', KINDS)
def test_the_judge_finds_a_way_on_any_road(kind):
    pytest.importorskip('casadi')
    task = Study(kind).run(0)
    found = judging.judge_failure(task)
    assert found['answer'] == judging.FEASIBLE
    assert found['clearance_m'] >= task.settings.safety.margin - 1e-6
