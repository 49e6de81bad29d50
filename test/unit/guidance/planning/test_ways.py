"""Ways past walls, crates and groups, on corridors and on open floor: none of them is a trap."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import ROAD, closed_loop, settings

from cmpsp_ros.guidance import FallbackLevel, Safety
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, Obstacle, convex
from cmpsp_ros.world.roads import Corridor, OpenFloor

START, GOAL = (0.5, 0.0, 0.0), (8.5, 0.0)
POINTS = tuple((float(x), 0.0) for x in range(0, 10, 3))
EVEN = Corridor(POINTS, (1.0,) * 4, (1.0,) * 4)
UNEQUAL = Corridor(POINTS, (0.4,) * 4, (1.6,) * 4)
BEND = Corridor(((0.0, 0.0), (3.0, 0.0), (6.0, 1.5), (7.0, 4.0)), (1.0,) * 4, (1.0,) * 4)
FLOOR = OpenFloor()


def wall(x, low, high, name='wall'):
    return Capsule(name, (x, low), (x, high), 0.05)


def crate(x, low, high, deep=0.4, name='crate'):
    corners = ((x, low), (x + deep, low), (x + deep, high), (x, high))
    return convex(name, corners)


GROUP = (wall(5.0, -0.6, 0.6), Obstacle('post', (4.6, 0.8), 0.4), crate(4.8, -1.4, -0.5))
SCENES = {
    'a wall from the left edge': (EVEN, (wall(5.0, -0.2, 1.2),)),
    'a wall from the right edge': (EVEN, (wall(5.0, -1.2, 0.3),)),
    'a wall on the centre line': (EVEN, (wall(5.0, -0.4, 0.4),)),
    'a thin crate': (EVEN, (crate(5.0, -0.5, 0.3, deep=0.05),)),
    'a crate': (EVEN, (crate(4.8, -0.4, 0.4),)),
    'unequal widths': (UNEQUAL, (Obstacle('post', (5.0, 0.1), 0.45),)),
    'a blocked side': (EVEN, (Obstacle('post', (4.0, 0.8), 0.4), wall(6.0, 0.0, 1.2))),
    'walls in turn': (
        EVEN,
        (wall(3.0, -0.2, 1.2, 'a'), wall(5.0, -1.2, 0.2, 'b'), wall(7.0, -0.2, 1.2, 'c')),
    ),
    'a wall on the floor': (FLOOR, (wall(5.0, -0.6, 0.6),)),
    'a long wall on the floor': (FLOOR, (wall(5.0, -2.6, 2.5),)),
    'a group on the floor': (FLOOR, GROUP),
}


def given_on(road, obstacles, goal=GOAL, **changes):
    return settings(obstacles, 51.0, ROAD, road=road, goal=goal, **changes)


def assert_arrives_clear(run, given):
    space = FreeSpace.of(given.road, given.obstacles, given.robot_radius)
    twists = np.array([each.twist for each in run.moves])
    clearance = space.along(run.path[: len(twists)], twists, np.full(len(twists), 0.2))
    assert clearance.min() >= 0.0
    assert run.miss(given.goal) < 1e-3


@pytest.mark.parametrize('scene', SCENES)
def test_nothing_beside_which_there_is_room_is_a_trap(scene):
    given = given_on(*SCENES[scene])
    assert_arrives_clear(closed_loop(given, START), given)


def dead_end(x, deep, wide=1.6):
    """Three walls: the back at `x`, open to the left of it, or to the right where `deep` < 0."""
    low, high = -wide / 2.0, wide / 2.0
    sides = [
        Capsule(name, (x, y), (x - deep, y), 0.05) for name, y in (('left', high), ('right', low))
    ]
    return (wall(x, low, high, 'back'), *sides)


@pytest.mark.parametrize(
    'obstacles',
    [dead_end(1.5, 1.5), dead_end(1.2, 2.0, 1.2), dead_end(7.7, -1.5)],
    ids=['begins in one', 'begins deep in one', 'ends in one'],
)
def test_a_dead_end_is_left_and_entered_where_it_is_open(obstacles):
    given = given_on(FLOOR, obstacles, final_time=14.0)
    assert_arrives_clear(closed_loop(given, START, steps=70), given)


def test_a_way_that_leads_on_where_no_robot_can_follow_is_no_trap():
    """Past the tip of a slanted wall, beside which station by station there is a gap."""
    tip, corner, back, end = (-1.44, 0.33), (0.0, -0.92), (0.89, 0.12), (-0.53, 1.38)
    sides = ((tip, corner), (corner, back), (back, end))
    walls = tuple(Capsule(f'wall{i}', *side, 0.05) for i, side in enumerate(sides))
    safe = Safety(margin=0.02)
    given = given_on(
        FLOOR, walls, goal=(-3.1, -6.82), final_time=15.2, robot_radius=0.1, safety=safe
    )
    assert_arrives_clear(closed_loop(given, (0.0, 0.0, -1.68), steps=76), given)


def test_behind_walls_all_round_nothing_is_found():
    around = (*dead_end(1.5, 2.0), wall(-0.5, -0.8, 0.8, 'front'))
    given = given_on(FLOOR, around, final_time=4.0)
    run = closed_loop(given, START, steps=20)
    space = FreeSpace.of(FLOOR, around, 0.0)
    assert space.at(run.path).min() > 0.0
    assert FallbackLevel.STOP in {each.level for each in run.moves}


def test_some_of_them_are_traps_for_one_plan():
    trapped = []
    for scene, course in SCENES.items():
        given = given_on(*course)
        alone = replace(given, solver=replace(given.solver, candidates=1))
        run = closed_loop(alone, START)
        if run.miss(given.goal) > 0.1:
            assert FallbackLevel.STOP in {each.level for each in run.moves}
            trapped.append(scene)
    assert len(trapped) >= 4


def test_a_wall_in_a_bend_is_passed_on_both_sides_of_the_road():
    for offset in (-0.5, 0.5):
        post = Obstacle('post', (4.6 - 0.35 * offset, 0.55 + 0.9 * offset), 0.3)
        given = given_on(BEND, (post,), goal=(6.8, 3.5))
        run = closed_loop(given, START)
        assert_arrives_clear(run, given)


def test_a_road_is_driven_backwards_past_a_wall():
    given = given_on(EVEN, (wall(5.0, -0.2, 1.2),), goal=(0.5, 0.0))
    assert_arrives_clear(closed_loop(given, (8.5, 0.0, math.pi)), given)


@pytest.mark.parametrize('reach', [(8.6, 10.2), (9.8, 11.4), (9.7, 10.3)])
def test_a_wall_between_two_circles_is_passed(reach):
    low, high = (tuple(each * math.sqrt(0.5) * np.array([1.0, -1.0])) for each in reach)
    given = settings((Capsule('wall', low, high, 0.05),), 51.0, ROAD)
    assert_arrives_clear(closed_loop(given, (0.0, -10.0, 0.0)), given)


def test_the_message_says_which_way():
    run = closed_loop(given_on(EVEN, (wall(5.0, -0.1, 0.6),)), START)
    assert run.decisions[0].reason.endswith('It is the best of 2 plans, right of wall.')


@pytest.mark.parametrize('center', [(0.5, 0.65), (0.5, -0.65), (0.1, 0.0)])
def test_an_obstacle_at_a_crossing_is_passed(center):
    values = TABLE.resolve(load_parameter_file('corridor'))
    given = guidance_settings(values)
    given = replace(given, obstacles=(*given.obstacles, Obstacle('post', center, 0.2)))
    assert_arrives_clear(closed_loop(given, values['initial_pose'], steps=100), given)
