"""Random courses: what is promised of every one of them."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmpsp_ros.studies.monte_carlo import Study, StudyError, judging
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import (
    FROM_EDGE,
    GAP,
    RADII,
    is_open,
    scenario,
)
from cmpsp_ros.studies.monte_carlo.driving import drive, outcome
from cmpsp_ros.studies.monte_carlo.guesses import grid_path
from cmpsp_ros.studies.monte_carlo.outcome import RunVerdict
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus

ROAD = Annulus((1.0, -2.0), 9.0, 11.0)
SETTINGS, _ = Study('nominal').setup()

seeds = st.integers(0, 2**64)
numbers = st.integers(0, 10**9)


def distance(x, y):
    return math.dist((x, y), SETTINGS.road.center)


@given(seeds, numbers, st.integers(0, 6))
@settings(max_examples=100)
def test_every_course_is_one_of_those_promised(seed, number, most):
    drawn = scenario(SETTINGS, seed, number, most)
    (x, y, heading), road, goal = drawn.pose, SETTINGS.road, SETTINGS.goal
    assert road.inner_radius + FROM_EDGE <= distance(x, y) <= road.outer_radius - FROM_EDGE
    bearing = math.atan2(y - road.center[1], x - road.center[0])
    along = bearing + math.copysign(math.pi / 2.0, road.angle_between((x, y), goal))
    assert abs(math.remainder(heading - along, math.tau)) <= math.pi / 2.0 + 1e-12
    assert len(drawn.obstacles) <= most
    for each in drawn.obstacles:
        assert RADII[0] <= each.radius <= RADII[1]
        assert math.dist(each.center, (x, y)) >= each.radius + FROM_EDGE
        assert math.dist(each.center, goal) >= each.radius + FROM_EDGE
    assert is_open(road, drawn.obstacles, GAP)


def test_both_studies_have_the_same_courses():
    nominal, disturbed = (Study(name, 5).run(7) for name in ('nominal', 'disturbed'))
    assert nominal.scenario == disturbed.scenario
    assert nominal.plant.odometry.position_stddev == 0.0 < disturbed.plant.odometry.position_stddev


@pytest.mark.parametrize(
    ('places', 'is_free'),
    [
        ([], True),
        ([(10.0, 0.79)], False),
        ([(10.0, 0.81)], False),
        ([(10.0, 0.59)], True),
        ([(9.7, 0.8)], True),
        ([(9.6, 0.7), (10.85, 0.1)], True),
        ([(9.5, 0.7), (10.7, 0.2)], False),
    ],
)
def test_a_road_is_open_where_a_disc_gets_through(places, is_free):
    obstacles = [Obstacle('o', (1.0 + away, -2.0), radius) for away, radius in places]
    assert is_open(ROAD, obstacles, 0.4) == is_free


def test_a_chain_across_the_road_blocks_it_though_every_bearing_has_a_gap():
    obstacles = [Obstacle('a', (10.6, -2.0), 0.4), Obstacle('b', (11.4, -1.0), 0.4)]
    assert is_open(ROAD, obstacles, 0.3)
    assert not is_open(ROAD, [*obstacles, Obstacle('c', (11.0, -1.5), 0.1)], 0.4)


@given(
    st.lists(st.tuples(st.floats(-0.3, 0.3), st.floats(9, 11), st.floats(0.05, 0.8)), max_size=4)
)
@settings(max_examples=20)
def test_a_road_is_open_as_a_grid_says(places):
    """Flood the road, in polar coordinates, from one side of the obstacles to the other."""
    obstacles = [
        Obstacle('o', (1.0 + r * math.cos(angle), -2.0 + r * math.sin(angle)), radius)
        for angle, r, radius in places
    ]
    # A wider or a narrower gap than the one the grid can resolve is no question.
    narrow, wide = (is_open(ROAD, obstacles, width) for width in (0.34, 0.46))
    assert wide <= narrow
    if narrow != wide:
        return
    angles, radii = np.linspace(-0.5, 0.5, 501)[:, None], np.arange(9.2, 10.8001, 0.02)[None]
    x, y = 1.0 + radii * np.cos(angles), -2.0 + radii * np.sin(angles)
    free = np.ones_like(x, dtype=bool)
    for each in obstacles:
        free &= np.hypot(x - each.center[0], y - each.center[1]) >= each.radius + 0.2
    reached, before = np.zeros_like(free), -1
    reached[0] = free[0]
    while reached.sum() > before:
        before = reached.sum()
        for axis, step in ((0, 1), (0, -1), (1, 1), (1, -1)):
            moved = np.roll(reached, step, axis)
            np.moveaxis(moved, axis, 0)[0 if step == 1 else -1] = False
            reached |= moved & free
    assert reached[-1].any() == narrow


def test_the_shortest_way_is_straight_or_around_the_inner_edge():
    assert ROAD.shortest_length((11.0, -2.0), (10.5, -1.0)) == math.dist((11.0, -2.0), (10.5, -1.0))
    half_round = ROAD.shortest_length((10.0, -2.0), (-8.0, -2.0))
    assert half_round == pytest.approx(9.0 * math.pi)
    tangent = math.sqrt(11.0**2 - 9.0**2)
    from_outside = 2.0 * tangent + 9.0 * (math.pi - 2.0 * math.acos(9.0 / 11.0))
    assert ROAD.shortest_length((12.0, -2.0), (-10.0, -2.0)) == pytest.approx(from_outside)


def test_a_robot_too_wide_for_the_road_is_refused():
    with pytest.raises(StudyError, match='road: found 2 m of width'):
        Study('nominal', assignments=('robot.radius=0.9',)).values()


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
    assert arrived(Study(kind), range(4)) == (list(range(4)), [])


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
