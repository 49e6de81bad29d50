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
BEND = Corridor(((0.0, 0.0), (3.0, 0.0), (6.0, 1.5), (7.0, 4.0)), (1.0,) * 4, (1.0,) * 4)
UNEQUAL = Corridor(POINTS, (0.4,) * 4, (1.6,) * 4)
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


def dead_end(x, deep, wide=1.6):
    """Three walls: the back at `x`, open to the left of it, or to the right where `deep` < 0."""
    low, high = -wide / 2.0, wide / 2.0
    sides = [
        Capsule(name, (x, y), (x - deep, y), 0.05) for name, y in (('left', high), ('right', low))
    ]
    return (wall(x, low, high, 'back'), *sides)


def in_a_bend(offset):
    post = Obstacle('post', (4.6 - 0.35 * offset, 0.55 + 0.9 * offset), 0.3)
    return given_on(BEND, (post,), goal=(6.8, 3.5)), START


def between_circles(*reach):
    low, high = (tuple(each * math.sqrt(0.5) * np.array([1.0, -1.0])) for each in reach)
    return settings((Capsule('wall', low, high, 0.05),), 51.0, ROAD), (0.0, -10.0, 0.0)


def beside_a_slanted_wall():
    """Past its tip there is a gap station by station, where no robot can follow."""
    tip, corner, back, end = (-1.44, 0.33), (0.0, -0.92), (0.89, 0.12), (-0.53, 1.38)
    sides = ((tip, corner), (corner, back), (back, end))
    walls = tuple(Capsule(f'wall{i}', *side, 0.05) for i, side in enumerate(sides))
    more = {'goal': (-3.1, -6.82), 'final_time': 15.2, 'robot_radius': 0.1}
    return given_on(FLOOR, walls, safety=Safety(margin=0.02), **more), (0.0, 0.0, -1.68)


def at_a_crossing(*center):
    values = TABLE.resolve(load_parameter_file('corridor'))
    given = guidance_settings(values)
    more = (*given.obstacles, Obstacle('post', center, 0.2))
    return replace(given, obstacles=more), values['initial_pose']


COURSES = {
    **{name: (given_on(*scene), START) for name, scene in SCENES.items()},
    **{
        f'a dead end {k}': (given_on(FLOOR, dead_end(*each), final_time=14.0), START)
        for k, each in enumerate([(1.5, 1.5), (1.2, 2.0, 1.2), (7.7, -1.5)])
    },
    'a slanted wall': beside_a_slanted_wall(),
    'left in a bend': in_a_bend(0.5),
    'right in a bend': in_a_bend(-0.5),
    'backwards': (given_on(EVEN, (wall(5.0, -0.2, 1.2),), goal=(0.5, 0.0)), (8.5, 0.0, math.pi)),
    'between circles, at the inner one': between_circles(8.6, 10.2),
    'between circles, at the outer one': between_circles(9.8, 11.4),
    'between circles, at neither': between_circles(9.7, 10.3),
    'left at a crossing': at_a_crossing(0.5, 0.65),
    'right at a crossing': at_a_crossing(0.5, -0.65),
    'on a crossing': at_a_crossing(0.1, 0.0),
}


@pytest.mark.parametrize('course', COURSES)
def test_nothing_beside_which_there_is_room_is_a_trap(course):
    given, start = COURSES[course]
    run = closed_loop(given, start, steps=round(given.final_time / given.control_period))
    assert run.miss(given.goal) < 1e-3
    twists, held = np.array([each.twist for each in run.moves]), np.full(len(run.moves), 0.2)
    poses = np.array([start, *(each[-1] for each in run.driven[1:-1])])
    space = FreeSpace.of(given.road, given.obstacles, given.robot_radius)
    assert space.along(poses, twists, held).min() >= -1e-9


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


def test_the_message_says_which_way():
    run = closed_loop(given_on(EVEN, (wall(5.0, -0.1, 0.6),)), START)
    assert run.decisions[0].reason.endswith('It is the best of 2 plans, right of wall.')
