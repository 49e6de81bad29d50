"""Clearance of a robot that several discs cover, at samples and between them."""

import numpy as np
import pytest

from cmpsp_ros.robots import DifferentialDrive, Footprint, mecanum, placed, plain
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, MovingDiscs, Obstacle
from cmpsp_ros.world.obstacles.shapes import Polygon
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor

ROAD = Annulus((0.5, -1.0), 7.0, 11.0)
BENT = Corridor(((-5.0, -9.5), (0.0, -9.5), (4.0, -8.0), (9.0, -5.0)), (2.0,) * 4, (2.0,) * 4)
OBSTACLES = (Obstacle('a', (1.8, -9.0), 0.3),)
SHAPES = (
    *OBSTACLES,
    Capsule('wall', (0.0, -8.5), (-1.0, -8.0), 0.1),
    Polygon('box', ((1.0, -11.0), (2.0, -11.0), (2.0, -10.4), (1.0, -10.4))),
)

DISCS = np.array([[0.5, 0.0], [0.0, 0.0], [-0.3, 0.4]])
ROBOTS = (
    DifferentialDrive(max_wheel_speed=51.0),
    mecanum(0.05, 0.02, wheel_radius=0.035, max_wheel_speed=51.0),
)


@pytest.mark.parametrize('robot', ROBOTS, ids=['differential', 'sideways'])
@pytest.mark.parametrize('road', [ROAD, OpenFloor(), BENT], ids=['ring', 'floor', 'bent'])
def test_clearance_of_several_discs_is_the_least_of_each_between_samples_too(robot, road):
    rng = np.random.default_rng(1)
    space = FreeSpace.of(road, SHAPES, 0.1, DISCS)
    point, pose = FreeSpace.of(road, SHAPES, 0.1), np.array([0.5, -9.5, 0.3])
    for _ in range(20):
        twist = rng.uniform([-1.5, -1.5 * robot.drives_sideways, -5.0], [1.5, 1.5, 5.0])
        wheels = robot.controls(plain(twist[None]))
        fine = robot.roll_out(pose, np.tile(wheels, (401, 1)), np.full(400, 0.5 / 400))
        each = [point.at(np.array([[*placed(DISCS, at)[i], at[2]] for at in fine]), 0.5)
                for i in range(3)]  # fmt: skip
        sampled = np.min(each, axis=0)
        np.testing.assert_allclose(space.at(fine, 0.5), sampled, atol=1e-9)
        swept = space.along(pose[None], robot.twist(wheels), np.array([0.5]))[0]
        # From the edges of a corridor to a hundredth of it.
        rounding = 1e-9 + 0.01 * np.abs(sampled).min(axis=0) * (np.arange(5) < 2)
        assert (swept <= sampled.min(axis=0) + rounding).all()
        assert (swept >= sampled.min(axis=0) - rounding - 5e-3).all()


def test_discs_that_are_clear_at_samples_are_clear_between_them():
    """With the limits of the disc that is fastest; with those of the reference point they cut."""
    rng, robot = np.random.default_rng(0), ROBOTS[0]
    footprint = Footprint(centers=tuple(map(tuple, DISCS.tolist())))
    space = FreeSpace.of(OpenFloor(), OBSTACLES, 0.0, DISCS)
    grown = space.tightened(footprint.twist_limits(robot), 0.2)
    less = space.tightened(robot.twist_limits(), 0.2)
    clear = cut = 0
    for _ in range(4000):
        pose = np.array([*OBSTACLES[0].center, 0.0]) + rng.uniform(-1.3, 1.3, 3)
        wheels = np.tile(rng.uniform(-51.0, 51.0, 2), (2, 1))
        times = np.full(1, 0.2)
        poses, twists = robot.roll_out(pose, wheels, times), robot.twist(wheels[:1])
        swept = space.along(poses[:1], twists, times).min()
        if grown.at(poses).min() >= 0.0:
            assert swept >= -1e-9
            clear += 1
        elif less.at(poses).min() >= 0.0 and swept < -1e-4:
            cut += 1
        known = space.for_samples_of(footprint.speeds_and_turns(twists), 0.2)
        if known.at(poses).min() >= 0.0:
            assert swept >= -1e-9
    assert clear > 100
    assert cut


def test_discs_without_a_heading_are_nowhere():
    space = FreeSpace.of(OpenFloor(), OBSTACLES, 0.0, DISCS)
    assert np.isnan(space.at(np.array([[0.0, 0.0, np.nan]]))[0, 2:]).all()


@pytest.mark.parametrize('robot', ROBOTS, ids=['differential', 'sideways'])
def test_moving_discs_are_missed_by_every_disc_of_the_robot(robot):
    rng, states = np.random.default_rng(2), np.array([[1.5, -9.0, -1.0, 0.4, 0.2]])
    moving, pose = (
        MovingDiscs(('cart',), states, 0.1, np.zeros(1, np.int64)),
        np.array([0, -9, 0.3]),
    )
    for _ in range(20):
        twist = rng.uniform([-1.5, -1.5 * robot.drives_sideways, -5.0], [1.5, 1.5, 5.0])
        wheels, times = robot.controls(plain(twist[None])), np.linspace(0.0, 0.5, 401)
        fine = robot.roll_out(pose, np.tile(wheels, (401, 1)), np.diff(times))
        sampled = [
            moving.after(time).clearance(point)[0]
            for time, at in zip(times.tolist(), fine, strict=True)
            for point in placed(DISCS, at)
        ]
        arc = pose[None], robot.twist(wheels), np.array([0.5]), np.zeros(1)
        swept = moving.along(*arc, DISCS)[0, 0]
        assert min(sampled) - 5e-3 <= swept <= min(sampled) + 1e-9
