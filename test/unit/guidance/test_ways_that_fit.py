"""Search and plan agree on what fits: the body, with its margin wherever a way has room for it."""

import numpy as np
import pytest
from tight_places import CELL, TightRun, map_of, task

from cmpsp_ros.guidance import FallbackLevel, Safety
from cmpsp_ros.guidance.mission import infeasibility_warnings
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.obstacles import Capsule, Obstacle, convex


@pytest.mark.parametrize('width', [0.2, 0.3])
def test_a_door_that_is_too_narrow_is_no_door(width):
    walls = (3, 3.1, 0, 2), (3, 3.1, 2 + width, 27), (3, 3.1, 28, 32)
    given = task((6.0, 2.15), map_of(8, 32, *walls))

    run = TightRun(given, (1.0, 2.15, 0.0), 120.0)

    assert run.miss < given.goal_tolerance
    assert run.clearance > 0.02
    assert run.time < 1.2 * (2.0 * 25.0 + 5.0) / given.pace


def test_where_no_other_door_is_the_run_warns():
    given = task((6.0, 2.15), map_of(8, 4, (3, 3.1, 0, 2), (3, 3.1, 2.3, 4)))

    (said,) = infeasibility_warnings(given, given.world, (1.0, 2.15))

    assert said.startswith('The map leaves no way from (1, 2.15) m to the goal')
    assert '0.350 m wide' in said


def gap(width, *more, margin=0.02):
    """A wall of capsules across a map, with a gap ahead."""
    low, high = 3.2 - width / 2.0 - CELL, 3.2 + width / 2.0 + CELL
    parts = [(0.0, low), (high, 4.95), *more]
    walls = [Capsule(f'w{k}', (3.0, a), (3.0, b), CELL) for k, (a, b) in enumerate(parts)]
    return task((6.0, 3.2), map_of(8, 8), *walls, safety=Safety(margin))


@pytest.mark.parametrize('width', [0.36, 0.38])
def test_a_gap_that_leaves_no_margin_is_not_taken_beside_a_wider_one(width):
    given = gap(width, (6.05, 8.0))

    run = TightRun(given, (1.0, 3.2, 0.0), 40.0)

    assert run.miss < given.goal_tolerance
    assert run.clearance > given.safety.margin
    assert run.levels[FallbackLevel.ELASTIC] == 0


def test_the_widest_gap_is_taken_where_all_leave_too_little():
    given = gap(0.46, (5.46, 8.0), margin=0.1)

    (said,) = infeasibility_warnings(given, given.world, (1.0, 5.2))
    line = given.world.map_search(given).line(np.array([1.0, 5.2]), given.goal, 0.05)

    assert 'no way from (1, 5.2) m to the goal with safety.margin, 0.1 m' in said
    assert np.abs(line[np.abs(line[:, 0] - 3.0) < 0.1, 1] - 3.2).max() < 0.1


def test_a_maze_of_narrow_corridors_is_crossed():
    corridors = 5
    walls = [
        (0, 3.4, 0.6 * k, 0.6 * k + 0.1) if k % 2 else (0.6, 4, 0.6 * k, 0.6 * k + 0.1)
        for k in range(1, corridors)
    ]
    given = task((3.6, 0.6 * corridors - 0.25), map_of(4, 0.6 * corridors + 0.1, *walls))

    run = TightRun(given, (0.4, 0.35, 0.0), 60.0)

    assert run.miss < given.goal_tolerance
    assert run.clearance > 0.0


def test_a_long_wall_on_open_floor_is_driven_around():
    given = task((10.0, 0.0), Capsule('wall', (5.0, -10.0), (5.0, 10.0), 0.05), final_time=45.0)

    run = TightRun(given, (0.0, 0.0, 0.0), 60.0)

    assert run.miss < given.goal_tolerance
    assert run.levels[FallbackLevel.STOP] == 1


@pytest.mark.parametrize('far', [(), (30.0, 118.0)])
def test_what_is_far_away_does_not_hide_the_way_out_of_a_trap(far):
    ends = ((1.0, -1.0), (1.0, 1.0)), ((-1.0, 1.0), (1.0, 1.0)), ((-1.0, -1.0), (1.0, -1.0))
    trap = [Capsule(f'w{k}', *each, 0.05) for k, each in enumerate(ends)]
    crates = [convex(f'crate{x:g}', [(x, 0.0), (x + 1.0, 0.0), (x + 1.0, 1.0)]) for x in far]
    given = task((4.0, 0.0), *trap, *crates, final_time=25.0)

    run = TightRun(given, (0.0, 0.0, 0.0), 40.0)

    assert run.miss < given.goal_tolerance
    assert run.levels[FallbackLevel.STOP] == 1


def test_a_gap_below_the_margin_far_ahead_stops_nobody():
    walls = (2.0, 2.5, 0.0, 2.0), (6.0, 6.1, 0.0, 1.5), (6.0, 6.1, 2.5, 4.0)
    post = Obstacle('post', (6.05, 1.83), 0.3)
    given = task((8.0, 1.0), map_of(9, 4, *walls), post, when='soonest', final_time=40.0)

    run = TightRun(given, (0.5, 1.0, 0.0), 40.0)

    assert run.miss < 0.1
    assert run.clearance > 0.0
    assert run.levels[FallbackLevel.STOP] == 1
    # The solver has an answer at nearly every control step.
    assert sum('work of this' in each.reason for each in run.decisions) <= 5


def room_with_gap(width, margin):
    """A closed room 13 m long with a wall across it and a gap in the wall, the only way."""
    low, high, half = -1.2, 1.2, width / 2.0 + CELL
    walls = (
        ((-1.0, low), (12.0, low)), ((-1.0, high), (12.0, high)),
        ((-1.0, low), (-1.0, high)), ((12.0, low), (12.0, high)),
        ((4.5, half), (4.5, high)), ((4.5, low), (4.5, -half)),
    )  # fmt: skip
    parts = [Capsule(f'w{k}', *each, CELL) for k, each in enumerate(walls)]
    robot = DifferentialDrive(max_wheel_speed=20.0, max_wheel_acceleration=50.0)
    return task((9.0, 0.0), *parts, robot=robot, safety=Safety(margin), when='soonest')


@pytest.mark.parametrize('width', [0.5, 0.42, 0.38])
def test_a_gap_that_takes_some_of_the_margin_is_passed_as_early_as_a_wider_one(width):
    given = room_with_gap(width, 0.05)

    run = TightRun(given, (0.0, 0.0, 0.0), 40.0)

    assert run.miss < given.goal_tolerance
    # 9 m, and half a second to gain speed and to lose it.
    assert run.time < 9.0 / given.robot.max_speed + 0.8
    assert run.clearance > (width - 0.35) / 2.0 - 0.005
    assert (run.levels[FallbackLevel.ELASTIC] > 0) == (width < 0.45)
    assert run.levels[FallbackLevel.STOP] <= 1
