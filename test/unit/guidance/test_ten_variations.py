"""Hard scenes, ten variations each: passed where a way exists, else given up soon."""

import math

import numpy as np
import pytest
from models import clearance, drive
from seeing import Drive
from test_never_stuck import box, seen
from tight_places import CELL, TightRun, map_of, task

from cmpsp_ros.guidance import FallbackLevel
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world.obstacles import Capsule, convex

# The first of each on a map is fast.
pytestmark = pytest.mark.parametrize(
    'number', [0, *(pytest.param(k, marks=pytest.mark.slow) for k in range(1, 10))]
)

MARGIN, WIDTH = 0.02, 0.35
"""Margin and width of the robot in :func:`tight_places.task` [m]."""
LONGEST_WAIT = 20.0
"""Without new ground, until a goal is given up [s]."""


def draw(number):
    """Random numbers of a variation, and settings: every other one with a limit, and soonest."""
    rng = np.random.default_rng(number)
    changes = {'when': 'soonest'} if number % 2 else {}
    if number % 4 > 1:
        changes['robot'] = DifferentialDrive(max_wheel_speed=20.0, max_wheel_acceleration=50.0)
    return rng, changes


def start(rng, x, y, spread=0.2):
    return (
        x + rng.uniform(-spread, spread),
        y + rng.uniform(-spread, spread),
        rng.uniform(-0.8, 0.8),
    )


def wall(x, *gaps, high):
    """Capsules across a map, with gaps from low to high [m]."""
    ends = [0.0, *(end for gap in gaps for end in gap), high]
    return [
        Capsule(f'w{k}', (x, low), (x, top), CELL)
        for k, (low, top) in enumerate(zip(ends[::2], ends[1::2], strict=True))
    ]


def gap(middle, width):
    """Ends of the capsules beside a gap of a width between their surfaces [m]."""
    return middle - width / 2.0 - CELL, middle + width / 2.0 + CELL


def is_driven(run, given):
    """It passes the goal; with a limit of acceleration and a fixed time it stops behind it."""
    assert not run.decisions[-1].missed
    assert min(math.dist(each[:2], given.goal) for each in run.poses) < given.goal_tolerance
    assert run.clearance > 0.0


def is_given_up(decisions, poses, clearance):
    """The end is a missed goal with its reason, soon after the last new cell of 0.1 m."""
    last = next(each for each in decisions if each.finished)
    assert last.missed
    assert 'The goal is unreachable: ' in last.reason
    assert clearance > 0.0
    visited, newest = set(), 0
    for each, pose in zip(decisions, poses, strict=False):
        if (cell := tuple(np.floor(pose[:2] / 0.1))) not in visited:
            visited.add(cell)
            newest = each.stamp
    assert last.stamp - newest < 1e9 * LONGEST_WAIT


def test_a_gap_below_the_margin_beside_a_wider_one(number):
    rng, changes = draw(number)
    narrow = gap(3.2, WIDTH + rng.uniform(0.01, 2.0 * MARGIN - 0.005))
    wide = gap(rng.uniform(5.0, 6.5), WIDTH + 2.0 * MARGIN + rng.uniform(0.06, 0.6))
    given = task((6.0, 3.2), map_of(8, 8), *wall(3.0, narrow, wide, high=8.0), **changes)
    run = TightRun(given, start(rng, 1.0, 3.2), 60.0)
    is_driven(run, given)
    assert run.clearance > MARGIN - 1e-3


def test_a_door_that_is_too_narrow_and_one_far_away(number):
    rng, changes = draw(number)
    low, far = rng.uniform(1.5, 3.0), rng.uniform(15.0, 26.0)
    width = rng.uniform(0.2, 0.32)
    walls = (3, 3.1, 0, low), (3, 3.1, low + width, far), (3, 3.1, far + 0.8, 32)
    given = task((6.0, low + 0.15), map_of(8, 32, *walls), **changes)
    run = TightRun(given, start(rng, 1.0, low + 0.15), 150.0)
    is_driven(run, given)
    assert run.time < 1.2 * (2.0 * far + 5.0) / given.pace


def test_a_maze_of_corridors(number):
    rng, changes = draw(number)
    corridors = 3 + number % 3
    pitch = WIDTH + 2.0 * MARGIN + 0.1 + CELL * rng.integers(1, 4) + CELL * 0.2
    pitch = CELL * math.ceil(pitch / CELL)
    walls = [
        (0, 3.4 - 0.2 * rng.random(), pitch * k, pitch * k + 0.1)
        if k % 2
        else (pitch + 0.2 * rng.random(), 4, pitch * k, pitch * k + 0.1)
        for k in range(1, corridors)
    ]
    goal = 3.5 if corridors % 2 else 0.5
    goal = (goal, pitch * corridors - pitch / 2.0 + 0.05)
    given = task(goal, map_of(4, pitch * corridors + 0.1, *walls), **changes)
    is_driven(TightRun(given, (0.4, pitch / 2.0 + 0.05, 0.0), 90.0), given)


def test_a_long_wall_on_open_floor(number):
    rng, changes = draw(number)
    half, along = rng.uniform(5.0, 10.0), rng.uniform(-3.0, 3.0)
    barrier = Capsule('wall', (5.0, along - half), (5.0, along + half), 0.05)
    given = task((10.0, 0.0), barrier, **(changes | {'final_time': 45.0}))
    run = TightRun(given, start(rng, 0.0, 0.0), 80.0)
    is_driven(run, given)
    assert run.levels[FallbackLevel.STOP] == 1


def test_a_trap_and_a_crate_far_away(number):
    rng, changes = draw(number)
    half, far = rng.uniform(0.8, 1.5), rng.uniform(20.0, 120.0)
    ends = ((1.0, -half), (1.0, half)), ((-1.0, half), (1.0, half)), ((-1.0, -half), (1.0, -half))
    trap = [Capsule(f'w{k}', *each, 0.05) for k, each in enumerate(ends)]
    crate = convex('crate', [(far, 0.0), (far + 1.0, 0.0), (far + 1.0, 1.0)])
    given = task((4.0, 0.0), *trap, crate, **(changes | {'final_time': 25.0}))
    run = TightRun(given, start(rng, 0.0, 0.0), 60.0)
    is_driven(run, given)
    assert run.levels[FallbackLevel.STOP] == 1


def sensed(number, changes):
    return changes | ({'goal.when': 'soonest'} if number % 2 else {})


@pytest.mark.slow
def test_a_corridor_that_two_crates_close(number):
    rng, _ = draw(number)
    width, at = rng.uniform(0.05, 0.32), rng.uniform(2.5, 5.0)
    middle = rng.uniform(-0.3, 0.3)
    walls = {
        'left': box(-2.0, 10.0, 1.0, 1.2),
        'right': box(-2.0, 10.0, -1.2, -1.0),
        'back': box(-2.2, -2.0, -1.2, 1.2),
        'one': box(at, at + 0.6, -1.0, middle - width / 2.0),
        'other': box(at, at + 0.6, middle + width / 2.0, 1.0),
    }
    run = Drive(end=70.0, **sensed(number, seen([8.0, 0.0], 12.0, **walls)))
    is_given_up(run.decisions, run.poses, run.clearance)


@pytest.mark.slow
def test_a_start_whose_front_has_not_been_seen(number):
    rng, _ = draw(number)
    jackal = '[[0.254, 0.215], [0.254, -0.215], [-0.254, -0.215], [-0.254, 0.215]]'
    x, y = rng.uniform(1.5, 3.0), rng.uniform(-0.4, 0.4)
    given = seen([5.0, 0.0], 12.0, crate=box(x, x + 0.4, y - 0.3, y + 0.3)) | {
        'robot.footprint': jackal,
        'initial_pose': [0.0, 0.0, rng.uniform(-3.1, 3.1)],
    }
    run = Drive(end=40.0, **sensed(number, given))
    assert not run.decisions[-1].missed
    assert min(math.dist(each[:2], (5.0, 0.0)) for each in run.poses) < 0.05
    assert run.clearance > 0.0


def is_parked(preset, **changes):
    settings, decisions, motions, pose = drive(preset, *(f'{k}={v}' for k, v in changes.items()))
    away, turned = settings.target.errors(pose)
    assert (decisions[-1].finished, decisions[-1].missed) == (True, False)
    assert away < settings.goal_tolerance
    assert turned < settings.heading_tolerance
    assert clearance(settings, motions) > 0.0


@pytest.mark.slow
def test_a_car_parks_at_the_kerb(number):
    rng, _ = draw(number)
    length = 0.58 * rng.uniform(1.3, 1.6)
    front = 2.0 + length
    is_parked(
        'parallel_parking',
        **{
            'obstacles.front_car.vertices': box(front, front + 0.6, -0.95, -0.6),
            'goal.position': [2.0 + (length - 0.58) / 2.0 + 0.1186, -0.775],
            'initial_pose': rng.uniform((1.2, -0.3, -0.2), (2.2, 0.1, 0.2)).tolist(),
        },
    )


@pytest.mark.slow
def test_a_base_backs_into_a_bay(number):
    rng, _ = draw(number)
    wide = 2.0 * 0.175 + rng.uniform(0.05, 0.1)
    is_parked(
        'parking',
        **{
            'robot.model': 'differential_drive',
            'robot.wheel_radius': 0.03575,
            'robot.half_track': 0.1165,
            'robot.max_wheel_speed': 8.0,
            'robot.max_wheel_acceleration': 0.0,
            'robot.max_steering_rate': 0.0,
            'robot.joint_names': '[right, left]',
            'robot.footprint': '""',
            'robot.radius': 0.175,
            'safety.margin': 0.005,
            'obstacles.left_car.vertices': box(1.25, 2.0 - wide / 2.0, -1.75, -1.15),
            'obstacles.right_car.vertices': box(2.0 + wide / 2.0, 2.75, -1.75, -1.15),
            'initial_pose': [rng.uniform(0.5, 3.5), rng.uniform(-0.2, 0.5), rng.uniform(-3, 3)],
        },
    )
