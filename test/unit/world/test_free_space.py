"""Free space of the robot's centre, and of the discs that cover a robot."""

import math

import numpy as np
from dense_drives import PIECES, error_of, integrated
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive, Footprint
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus, OpenFloor

ROAD = Annulus((0.5, -1.0), 9.0, 11.0)


@hypothesis_settings(max_examples=150)
@given(
    limit=st.floats(1.0, 80.0),
    wheels=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), min_size=1, max_size=5),
    period=st.floats(0.02, 0.5),
    heading=st.floats(-math.pi, math.pi),
    bearing=st.floats(-math.pi, math.pi),
    edge=st.sampled_from(['inner', 'outer']),
    further=st.floats(0.0, 0.3),
)
def test_no_edge_of_the_road_is_crossed(limit, wheels, period, heading, bearing, edge, further):
    """Against a dense integration without any formula of ours."""
    robot = DifferentialDrive(max_wheel_speed=limit)
    space = FreeSpace.of(ROAD, (), 0.0).tightened(robot.twist_limits(), period)
    inner, outer = space.annulus.inner.item(), space.annulus.outer.item()
    out = inner + further if edge == 'inner' else outer - further
    away = out * np.array([math.cos(bearing), math.sin(bearing)])
    pose = np.array([*(ROAD.center + away), heading])
    wheels = limit * np.array(wheels)
    distance = np.linalg.norm(integrated(pose, wheels, period, robot) - ROAD.center, axis=1)
    at = distance[::PIECES]
    fine = (at >= inner - 1e-12) & (at <= outer + 1e-12)
    kept = fine[:-1] & fine[1:]
    assume(kept.any())
    for k in np.flatnonzero(kept):
        within = distance[k * PIECES : (k + 1) * PIECES + 1]
        error = error_of(wheels, period, robot)
        assert within.min() >= ROAD.inner_radius - error
        assert within.max() <= ROAD.outer_radius + error


ROCK = (Obstacle('a', (1.8, -9.0), 0.3),)
DISCS = np.array([[0.5, 0.0], [0.0, 0.0], [-0.3, 0.4]])


def test_discs_that_are_clear_at_samples_are_clear_between_them():
    """With the limits of the disc that is fastest; with those of the reference point they cut."""
    rng, robot = np.random.default_rng(0), DifferentialDrive(max_wheel_speed=51.0)
    footprint = Footprint(centers=tuple(map(tuple, DISCS.tolist())))
    space = FreeSpace.of(OpenFloor(), ROCK, 0.0, DISCS)
    grown = space.tightened(footprint.twist_limits(robot), 0.2)
    less = space.tightened(robot.twist_limits(), 0.2)
    clear = cut = 0
    for _ in range(4000):
        pose = np.array([*ROCK[0].center, 0.0]) + rng.uniform(-1.3, 1.3, 3)
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
    space = FreeSpace.of(OpenFloor(), ROCK, 0.0, DISCS)
    assert np.isnan(space.at(np.array([[0.0, 0.0, np.nan]]))[0, 2:]).all()
