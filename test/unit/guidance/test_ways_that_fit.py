"""Search and plan agree on what fits: the body, with its margin wherever a way has room for it."""

import numpy as np
import pytest
from tight_places import CELL, TightRun, map_of, task

from cmpsp_ros.guidance import FallbackLevel, Safety
from cmpsp_ros.guidance.mission import infeasibility_warnings
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.obstacles import Capsule, Obstacle


def test_where_no_other_door_is_the_run_warns():
    given = task((6.0, 2.15), map_of(8, 4, (3, 3.1, 0, 2), (3, 3.1, 2.3, 4)))

    (said,) = infeasibility_warnings(given, given.world, (1.0, 2.15))

    assert said.startswith('The map leaves no way from (1, 2.15) m to the goal')
    assert '0.350 m wide' in said


def test_the_widest_gap_is_taken_where_all_leave_too_little():
    ends = (0.0, 3.2 - 0.23 - CELL), (3.2 + 0.23 + CELL, 4.95), (5.46, 8.0)
    walls = [Capsule(f'w{k}', (3.0, low), (3.0, top), CELL) for k, (low, top) in enumerate(ends)]
    given = task((6.0, 3.2), map_of(8, 8), *walls, safety=Safety(0.1))

    (said,) = infeasibility_warnings(given, given.world, (1.0, 5.2))
    line = given.world.map_search(given).line(np.array([1.0, 5.2]), given.goal, 0.05)

    assert 'no way from (1, 5.2) m to the goal with safety.margin, 0.1 m' in said
    assert np.abs(line[np.abs(line[:, 0] - 3.0) < 0.1, 1] - 3.2).max() < 0.1


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
