"""The search for homotopy classes, guesses that follow them, and lines searched on a grid."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example
from hypothesis import given as for_all
from hypothesis import settings as profile
from hypothesis import strategies as st
from scenarios import FIRST, ROAD, SECOND, START, clearance, settings, start_of

from cmpsp_ros.guidance import GuidanceLaw, Observation, Safety
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import along_road
from cmpsp_ros.guidance.planning.homotopy.path_search import (
    MAX_CLASSES,
    class_of,
    guide_paths,
    in_words,
    searched_line,
    turning_first,
)
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import OpenFloor

# What is kept from the bounds of a gap, and cut where a bend is too sharp for the limit [m].
ROOM = 0.08

DURATIONS = np.full(50, 0.2)


def search(given, start=START, limit=MAX_CLASSES):
    pose, begin, target = np.array(start), start_of(given, start), given.target
    guess = along_road(given, begin, target, DURATIONS)
    space = OcpFormulation(given, given.world).space(given.world, guess, DURATIONS, target)
    ways = guide_paths(given, space, begin, target, DURATIONS, limit)
    paths = [given.robot.roll_out(pose, way.guess, DURATIONS) for way in ways]
    return space, ways, paths


def centers(given):
    return np.array([each.center for each in given.obstacles]).reshape(-1, 2)


def at(bearing, radius, size, name='o'):
    place = (radius * math.cos(bearing), radius * math.sin(bearing))
    return Obstacle(name, place, size)


# Past a small one between two large ones at the other edge.
BEND = (
    Obstacle('o0', (3.232054214551504, -9.72709234839476), 0.5),
    Obstacle('o1', (4.53550928402291, -8.061740229909544), 0.125),
    Obstacle('o2', (5.826336509510572, -6.8595774562245575), 0.5),
)


def test_a_free_road_has_one_way_along_its_centre_line():
    given = settings((), 51.0, ROAD)
    _, [way], [path] = search(given)
    assert way.homotopy_class == ()
    radius = np.hypot(path[:, 0], path[:, 1])
    assert abs(radius[10:] - 10.0).max() < 0.1
    assert math.dist(path[-1, :2], given.goal) < 0.2
    assert way.guess.shape == (51, 2)


def test_two_obstacles_can_be_passed_in_four_ways():
    given = settings((FIRST, SECOND), 51.0, ROAD)
    space, ways, paths = search(given)
    assert {way.homotopy_class for way in ways} == {(1, 1), (1, -1), (-1, 1), (-1, -1)}
    assert [way.cost for way in ways] == sorted(way.cost for way in ways)
    for way, path in zip(ways, paths, strict=True):
        away = np.linalg.norm(path[:, None, :2] - space.centers, axis=2)
        assert (away > space.radii).all()
        assert (
            class_of(way.frame, way.frame.coordinates(centers(given)), path) == way.homotopy_class
        )


def test_a_gap_through_which_a_path_fits_between_two_samples_is_a_way():
    """Samples would have to keep more than there is on the inside, by a centimetre or so."""
    near = at(-0.8, 9.59, 0.475)
    given = settings((near,), 51.0, ROAD)
    space, ways, _ = search(given)
    assert 9.59 - space.radii[0] < space.annulus.inner[0] < 9.59 - near.radius
    assert {way.homotopy_class for way in ways} == {(1,), (-1,)}
    assert len(search(settings((at(-0.8, 9.59, 0.55),), 51.0, ROAD))[1]) == 1


def test_no_more_ways_than_asked_for():
    given = settings((FIRST, SECOND), 51.0, ROAD)
    every = search(given)[1]
    some = search(given, limit=2)[1]
    assert [way.homotopy_class for way in some] == [way.homotopy_class for way in every[:2]]


@pytest.mark.parametrize('clockwise', [False, True])
def test_left_is_left_in_both_directions(clockwise):
    side = -1.0 if clockwise else 1.0
    # Off the centre line to the outside, so that the inside is nearer.
    given = settings((at(-0.8 * side, 10.3, 0.3),), 51.0, ROAD)
    start = (10.0 * math.cos(1.4), -side * 10.0 * math.sin(1.4), side * (math.pi / 2.0 - 1.4))
    _, ways, paths = search(given, start)
    assert ways[0].homotopy_class == ((-1,) if clockwise else (1,))
    nearest = np.linalg.norm(paths[0][:, :2] - given.obstacles[0].center, axis=1).argmin()
    heading, offset = paths[0][nearest, 2], given.obstacles[0].center - paths[0][nearest, :2]
    on_its_right = offset @ (math.sin(heading), -math.cos(heading)) > 0.0
    assert on_its_right != clockwise


def test_a_gap_that_is_closed_is_no_way():
    # Only 5 cm are left outside, which growing takes; inside there is half a metre.
    given = settings((at(-0.8, 10.2, 0.75),), 51.0, ROAD)
    assert [way.homotopy_class for way in search(given)[1]] == [(1,)]


def test_a_closed_road_has_no_way():
    assert search(settings((at(-0.8, 10.0, 1.1),), 51.0, ROAD))[1] == []


def test_overlapping_obstacles_are_passed_on_one_side():
    cluster = (at(-0.8, 9.8, 0.3, 'a'), at(-0.8, 10.2, 0.3, 'b'))
    assert {way.homotopy_class for way in search(settings(cluster, 51.0, ROAD))[1]} == {
        (1, 1),
        (-1, -1),
    }


def test_what_is_behind_does_not_count():
    given = settings((at(-1.9, 10.0, 0.3), at(0.5, 10.0, 0.3)), 51.0, ROAD)
    assert [way.homotopy_class for way in search(given)[1]] == [(0, 0)]


def test_from_within_an_obstacle_both_sides_are_open():
    given = settings((at(-0.8, 10.0, 0.4),), 51.0, ROAD)
    start = (10.0 * math.cos(-0.82), 10.0 * math.sin(-0.82), math.pi / 2.0 - 0.8)
    assert {way.homotopy_class for way in search(given, start)[1]} == {(1,), (-1,)}


@pytest.mark.parametrize('start', [(10.0, -0.1, 1.5), (10.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_nowhere_to_drive_and_nowhere_on_the_road(start):
    for way in search(settings((FIRST, SECOND), 51.0, ROAD), start)[1]:
        assert np.isfinite(way.guess).all()


@st.composite
def obstacles(draw):
    """Up to six discs, one after another, each leaving half a metre beside it."""
    count = draw(st.integers(0, 6))
    found = []
    for index in range(count):
        size = draw(st.floats(0.1, 0.5))
        radius = draw(st.floats(9.0, 11.0))
        found.append(at(-1.25 + 1.15 * index / 6.0, radius, size, f'o{index}'))
    return tuple(found)


@profile(max_examples=40, deadline=None)
@for_all(obstacles(), st.sampled_from([math.inf, 51.0]))
@example(BEND, 51.0)
@example(BEND, math.inf)
def test_guesses_stay_in_the_gaps_that_they_are_for(found, limit):
    given = settings(found, limit, ROAD)
    _, ways, paths = search(given)
    assert 1 <= len(ways) <= MAX_CLASSES
    assert len({way.homotopy_class for way in ways}) == len(ways)
    bound = min(limit, 1e6)
    for way, path in zip(ways, paths, strict=True):
        assert np.abs(way.guess).max() <= bound
        assert np.isfinite(way.guess).all()
        inside = np.hypot(path[:, 0], path[:, 1])
        assert inside.min() > given.road.inner_radius
        assert inside.max() < given.road.outer_radius
        taken = class_of(way.frame, way.frame.coordinates(centers(given)), path)
        near = np.linalg.norm(path[:, None, :2] - centers(given), axis=2).min(axis=0)
        for each, a, b, away in zip(given.obstacles, taken, way.homotopy_class, near, strict=True):
            # One that is too slow to come by has not chosen yet.
            assert a in (0, b) or (limit < math.inf and away < each.radius + ROOM)
        if found:
            # Pursuit cuts corners where the gap is narrow; the iterations mend it.
            size = np.array([each.radius for each in found])
            assert (room(given, path) > -np.minimum(0.15, 0.9 * size)).all()


def room(given, path):
    """Distance of a path's samples from each obstacle [m]."""
    away = np.linalg.norm(path[:, None, :2] - centers(given), axis=2)
    return away - [each.radius for each in given.obstacles]


def test_few_guesses_cut_a_corner():
    rng, cuts = np.random.default_rng(1), []
    for _ in range(100):
        bearings = -1.25 + 1.15 * np.arange(rng.integers(1, 7)) / 6.0
        found = [at(each, rng.uniform(9.0, 11.0), rng.uniform(0.1, 0.5)) for each in bearings]
        given = settings(tuple(found), 51.0, ROAD)
        cuts += [-room(given, path).min() for path in search(given)[2]]
    assert np.mean(np.array(cuts) > 0.0) < 0.05
    assert max(cuts) < 0.12


def length(way, given, start):
    """Length of a path along the arc [m]."""
    first, last = (math.atan2(each[1], each[0]) for each in (start, given.goal))
    bearings = np.linspace(first, first + math.remainder(last - first, math.tau), len(way.profile))
    x, y = way.profile * np.cos(bearings), way.profile * np.sin(bearings)
    return float(np.hypot(np.diff(x), np.diff(y)).sum())


@pytest.mark.parametrize('start', [(-2.9, 9.3, 1.1), (-2.9, -9.1, 0.0), (0.0, 10.9, 0.0)])
def test_a_way_for_which_there_is_hardly_time_is_the_shortest(start):
    given = settings((), 51.0, ROAD)
    shortest = given.road.shortest_length(start[:2], given.goal)
    ample = settings((), 102.0, ROAD)
    scarce = settings((), 1.02 * shortest / 10.0 / given.robot.wheel_radius, ROAD)
    _, [relaxed], _ = search(ample, start)
    _, [taut], [path] = search(scarce, start)
    assert length(taut, given, start) < 1.02 * shortest < length(relaxed, given, start)
    assert clearance(path, scarce) > 0.0


def test_out_of_a_pocket_a_way_leads_back_and_around():
    """Between an obstacle and the inner edge, where not even a path between samples fits on."""
    start = (-8.970, 1.744, 1.546)
    ahead, beyond = ((-9.194, 2.572), 0.669), ((-7.127, 7.245), 0.477)
    found = tuple(Obstacle(f'o{i}', *each) for i, each in enumerate((ahead, beyond)))
    given = settings(found, 51.0, ROAD, safety=Safety(margin=0.05))
    _, ways, _ = search(given, start)
    assert {way.homotopy_class for way in ways} == {(1, 1), (1, -1)}
    assert all(way.profile[1] > 10.1 for way in ways)


@pytest.mark.parametrize('heading', [-2.0, -0.3, 0.0, 0.8, 3.0])
def test_a_guess_that_turns_first_stays_where_it_is_until_it_faces_the_way(heading):
    given, start = settings((FIRST, SECOND), 51.0, ROAD), np.array([0.0, -9.25, heading])
    for way in search(given, start)[1]:
        guess = turning_first(given, way, start_of(given, start), DURATIONS)
        assert guess.shape == way.guess.shape
        path = given.robot.roll_out(start, guess, DURATIONS)
        moved = np.hypot(*(path[:, :2] - start[:2]).T)
        leaves = int((moved > 1e-9).argmax()) - 1
        assert np.abs(np.diff(path[: leaves + 1, 2])).max(initial=0.0) <= 0.6 + 1e-9
        # From there on it hardly turns.
        assert abs(path[leaves + 1, 2] - path[leaves, 2]) < 0.3
        # The way begins along the road, and 0 is the road's direction there.
        assert abs(math.remainder(path[leaves, 2], math.tau)) < 0.8


def test_a_turn_on_the_spot_is_no_faster_than_the_wheels():
    given, start = settings((FIRST,), 2.0, ROAD), np.array([0.0, -9.25, 3.0])
    way = search(given, start)[1][0]
    guess = turning_first(given, way, start_of(given, start), DURATIONS)
    assert np.abs(guess).max() <= 2.0 * (1.0 + 1e-9)


def test_words():
    assert in_words((), ()) == ''
    assert in_words((0, 0), ('a', 'b')) == ''
    assert in_words((0, -1), ('a', 'b')) == 'right of b'
    assert in_words((1, -1, 1), ('a', 'b', 'c')) == 'left of a, right of b and left of c'
    wanted = 'left of a, left of b, left of c, left of d, left of e and past 3 more'
    assert in_words((1,) * 8, 'abcdefgh') == wanted


def test_a_guess_changes_no_wheel_faster_than_it_can_and_turns_first_from_rest():
    away = (START[0], START[1], START[2] + math.pi)
    given = settings((), 51.0, ROAD)
    given = replace(given, robot=replace(given.robot, max_wheel_acceleration=60.0))
    _, [way], [path] = search(given, away)
    changes = np.diff(way.guess, axis=0, prepend=np.zeros((1, 2)))
    assert np.abs(changes).max() <= given.max_wheel_change + 1e-9
    turned = np.flatnonzero(np.cos(path[:, 2] - START[2]) > math.cos(0.6))[0]
    assert np.hypot(*(path[:turned, :2] - path[0, :2]).T).max() < 0.1
    assert math.dist(path[-1, :2], given.goal) < 1.0


@pytest.mark.parametrize('distance', [10.0, 310.0, 400.0, 5e3, 1e6])
@pytest.mark.parametrize('angle', [0.0, 0.5, 2.0, -1.5])
def test_a_line_leads_from_start_to_goal_at_any_distance(distance, angle):
    space = FreeSpace.of(OpenFloor(), (Obstacle('a', (0.5, 0.3), 0.2),), 0.1)
    goal = distance * np.array([math.cos(angle), math.sin(angle)])
    line = searched_line(space, np.zeros(2), goal)
    assert (line[[0, -1]] == [np.zeros(2), goal]).all()
    length = np.hypot(*np.diff(line, axis=0).T).sum()
    assert distance <= length * (1.0 + 1e-9)
    assert length < 1.15 * distance


@pytest.mark.parametrize('distance', [400.0, -5e3])
def test_the_law_drives_towards_a_goal_that_no_time_is_enough_for(distance):
    values = {**load_parameter_file('floor'), 'goal.position': [distance, distance / 3.0]}
    given = guidance_settings(TABLE.resolve(values))
    law, pose = GuidanceLaw(given, given.world), np.zeros(3)
    decision = law.step(Observation(0, pose))
    law.after_step()
    assert 'final_time would have to be' in law.warnings[0]
    assert decision.plan is not None
    assert math.dist(decision.plan.poses[-1][:2], given.goal) < math.hypot(*given.goal)
