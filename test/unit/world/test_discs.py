"""Discs that cover a robot, at samples and between them; `test_clearances` has their clearances."""

import numpy as np

from cmpsp_ros.robots import DifferentialDrive, Footprint
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import OpenFloor

OBSTACLES = (Obstacle('a', (1.8, -9.0), 0.3),)
DISCS = np.array([[0.5, 0.0], [0.0, 0.0], [-0.3, 0.4]])


def test_discs_that_are_clear_at_samples_are_clear_between_them():
    """With the limits of the disc that is fastest; with those of the reference point they cut."""
    rng, robot = np.random.default_rng(0), DifferentialDrive(max_wheel_speed=51.0)
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
