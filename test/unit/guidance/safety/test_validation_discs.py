"""The audit of a robot that several discs cover: each is swept along an arc of its own."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import start_of

from cmpsp_ros.guidance import GuidanceSettings, MovingObstacles
from cmpsp_ros.guidance.safety import Validator
from cmpsp_ros.robots import Ackermann, DifferentialDrive, Omnidirectional, covered, placed
from cmpsp_ros.world.obstacles import Capsule, MovingDiscs, Obstacle
from cmpsp_ros.world.obstacles.shapes import Polygon
from cmpsp_ros.world.roads import Corridor, OpenFloor

# Long, and the reference point is near its rear.
FOOTPRINT, RADIUS = covered([(-0.3, -0.2), (1.2, -0.2), (1.2, 0.2), (-0.3, 0.2)])
SHAPES = (
    Obstacle('pole', (1.6, 0.9), 0.2),
    Capsule('wall', (-1.5, -1.2), (1.0, -1.6), 0.1),
    Polygon('box', ((2.4, -0.6), (3.0, -0.6), (3.0, 0.2), (2.4, 0.2))),
)
ROBOTS = {
    'differential': (DifferentialDrive(max_wheel_speed=51.0), (30.0, 30.0)),
    'car': (
        Ackermann(wheel_radius=1.0, wheel_base=0.8, max_steering_angle=0.6, max_wheel_speed=2.0),
        (1.5, 0.6),
    ),
    'sideways': (
        Omnidirectional.mecanum(0.2, 0.2, wheel_radius=0.05, max_wheel_speed=40.0),
        (0.6, 0.6, 1.0),
    ),
}
TIMES = np.full(4, 0.2)
STATE = (2.5, 1.5, -0.5, -0.3, 0.3, 0.05, 0.0)
CART = MovingDiscs(('cart',), np.array([STATE]), np.zeros(1, np.int64))


def given_for(robot, obstacles=SHAPES, road=None):
    return GuidanceSettings(
        robot=robot,
        road=road or OpenFloor(),
        goal=(5.0, 0.0),
        obstacles=obstacles,
        robot_radius=RADIUS,
        footprint=FOOTPRINT,
        moving_obstacles=MovingObstacles(capacity=1),
    )


def sampled(given, pose, plan, moving):
    """Least clearance of all discs on 200 poses a step, ``(4, 200)``."""
    fine = given.robot.roll_out(pose, np.repeat(plan[:-1], 200, axis=0), np.full(800, 1e-3))[1:]
    discs = np.array([placed(FOOTPRINT.discs, each) for each in fine])
    headings = np.broadcast_to(fine[:, None, 2:], (*discs.shape[:2], 1))
    point = given.world.free_space(replace(given, footprint=type(FOOTPRINT)()))
    still = point.at(np.concatenate([discs, headings], axis=2).reshape(-1, 3))
    centers, radii = moving.at_times(1e-3 * np.arange(1, 801))
    cart = np.linalg.norm(discs - centers, axis=2) - radii - RADIUS
    least = np.minimum(still.reshape(800, -1).min(axis=1), cart.min(axis=1))
    return least.reshape(4, 200)


@pytest.mark.parametrize('name', ROBOTS)
@pytest.mark.parametrize('bent', [False, True])
def test_margins_are_those_of_a_fine_sampling_of_every_disc(name, bent):
    robot, spread = ROBOTS[name]
    points, width = ((-3.0, 0.0), (0.0, 0.0), (3.0, 0.5), (5.0, 2.0)), (2.0,) * 4
    road = Corridor(points, width, width) if bent else None
    given, rng, seen = given_for(robot, road=road), np.random.default_rng(3), set()
    validator = Validator(given)
    for _ in range(25):
        pose = np.array([*rng.uniform(-0.4, 0.4, 2), rng.uniform(-0.5, 0.5)])
        plan = rng.uniform(-1.0, 1.0, (5, len(spread))) * spread
        start = start_of(given, pose, moving=CART, reachable=CART, touchable=CART)._replace(
            previous_control=np.zeros(len(spread))
        )
        verdict, least = validator.check(start, plan, TIMES), sampled(given, pose, plan, CART)
        gap = 5e-3 + 0.01 * abs(least.min())
        assert least[0].min() - gap <= verdict.margin <= least[0].min() + gap
        assert least.min() - gap <= verdict.worst_margin <= least.min() + gap
        at_rest = validator.clearance_at(given.world, pose, CART).min()
        if at_rest >= 0.0 and abs(least[0].min()) > gap:
            assert verdict.passed == (least[0].min() > 0.0), verdict.reason
            seen.add(verdict.passed)
    assert True in seen


def test_a_turn_on_the_spot_that_swings_the_front_into_something_is_refused():
    """The reference point, and a disc about it alone, never come near the pole."""
    robot, _ = ROBOTS['differential']
    given = given_for(robot, (Obstacle('pole', (0.6, 0.75), 0.1),))
    plan = np.tile([10.0, -10.0], (5, 1))
    start = start_of(given, np.zeros(3))
    assert Validator(replace(given, footprint=type(FOOTPRINT)())).check(start, plan, TIMES).passed
    verdict = Validator(given).check(start, plan, TIMES)
    assert not verdict.passed
    assert 'too close to obstacle pole' in verdict.reason
    assert Validator(given).check(start, -plan, TIMES).passed


def test_a_robot_whose_front_is_in_an_obstacle_may_leave_it_and_not_go_deeper():
    robot, _ = ROBOTS['differential']
    given = given_for(robot, (Obstacle('pole', (1.3, 0.0), 0.1),))
    start, plan = start_of(given, np.zeros(3)), np.tile([10.0, 10.0], (5, 1))
    validator = Validator(given)
    assert validator.clearance_at(given.world, start.pose).min() < -0.05
    assert validator.why_no_start(given.world, start.pose).endswith(
        'inside obstacle pole: nothing is begun there.'
    )
    assert validator.check(start, -plan, TIMES).passed
    assert not validator.check(start, plan, TIMES).passed


def test_a_stop_must_be_clear_for_every_disc():
    """Braking takes the front into the box, while the reference point is far from it."""
    robot, _ = ROBOTS['differential']
    robot = replace(robot, max_wheel_acceleration=20.0)
    given, held = given_for(robot), np.array([30.0, 30.0])
    plan = np.tile(held, (5, 1))
    start = start_of(given, np.array([0.85, -0.2, 0.0]), previous_control=held)
    verdict = Validator(given).check(start, plan, TIMES)
    assert verdict.reason.startswith('To stop after the next 0.2 s leads ')
    assert verdict.reason.endswith(' into obstacle box.')
    back = start_of(given, np.array([0.2, -0.2, 0.0]), previous_control=held)
    assert Validator(given).check(back, plan, TIMES).passed


def test_rows_of_every_disc_have_the_same_names():
    given = given_for(ROBOTS['differential'][0])
    validator = Validator(given)
    rows = 2 + len(SHAPES) + 1
    names = 'obstacle pole, obstacle box, cart'
    assert validator.names([2, 4, rows + 2, rows + 4, rows + 5], given.world, CART) == names
    assert not math.isnan(validator.clearance_at(given.world, np.zeros(3)).min())
