"""Free space of the robot's centre, and of the discs that cover a robot."""

import math

import numpy as np
from dense_drives import PIECES, error_of, integrated
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive, Footprint
from cmpsp_ros.world import FreeSpace, outside
from cmpsp_ros.world.inter_sample_margin import inside, inside_known, outside_known
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus, OpenFloor

ROAD = Annulus((0.5, -1.0), 9.0, 11.0)
OBSTACLES = (Obstacle('a', (8.0, -6.0), 0.7), Obstacle('b', (10.0, -2.0), 0.5))
LIMITS = DifferentialDrive(max_wheel_speed=51.0).twist_limits()


def test_road_shrinks_and_obstacles_grow():
    assert ROAD.center_radius == 10.0
    space = FreeSpace.of(ROAD, OBSTACLES, 0.2)
    np.testing.assert_array_equal(space.centers, [[8.0, -6.0], [10.0, -2.0]])
    np.testing.assert_array_equal(space.annulus.center, [0.5, -1.0])
    assert (space.annulus.inner, space.annulus.outer) == (9.2, 10.8)
    np.testing.assert_allclose(space.radii, [0.9, 0.7])


def test_no_obstacles():
    space = FreeSpace.of(ROAD, (), 0.0)
    assert space.centers.shape == (0, 2)
    assert space.radii.shape == (0,)
    twists = np.ones((4, 2))
    for other in (space.tightened(LIMITS, 0.2), space.for_samples_of(twists, 0.2)):
        clearance = other.at(np.tile([10.5, -1.0, 0.0], (5, 1)))
        assert clearance.shape == (5, 2)
        assert (clearance > 0.9).all()


def test_clearance_by_hand():
    space = FreeSpace.of(ROAD, OBSTACLES, 0.0)
    poses = np.array([[9.0, -6.0, 0.0], [0.5, 10.25, 3.0]])
    away = [math.hypot(8.5, 5.0), math.hypot(1.0, 4.0)]
    np.testing.assert_allclose(space.at(poses)[0], [11 - away[0], away[0] - 9, 0.3, away[1] - 0.5])
    np.testing.assert_allclose(space.at(poses)[1, :2], [-0.25, 2.25])
    # Through the middle of obstacle a, from the inner edge outward.
    way = space.along(np.array([[6.0, -6.0, 0.0]]), np.array([[4.0, 0.0]]), np.array([1.0]))
    np.testing.assert_allclose(way[0, 1:3], [math.hypot(5.5, 5.0) - 9.0, -0.7])
    np.testing.assert_allclose(way[0, 0], 11.0 - math.hypot(9.5, 5.0))


def test_samples_keep_what_the_worst_arc_needs():
    space = FreeSpace.of(ROAD, OBSTACLES, 0.1)
    grown = space.tightened(LIMITS, 0.2)
    assert grown.annulus.inner == outside(9.1, LIMITS, 0.2)
    assert grown.annulus.outer == inside(10.9, LIMITS, 0.2)
    np.testing.assert_array_equal(
        grown.radii, [outside(radius, LIMITS, 0.2) for radius in space.radii.tolist()]
    )
    np.testing.assert_array_equal(grown.centers, space.centers)


def test_samples_of_a_plan_keep_what_their_two_arcs_need():
    space = FreeSpace.of(ROAD, OBSTACLES, 0.0)
    twists = np.array([[1.0, 0.0], [1.8, 2.0], [0.5, -3.0]])
    grown = space.for_samples_of(twists, 0.2)
    assert grown.annulus.inner.shape == grown.annulus.outer.shape == (4,)
    assert grown.radii.shape == (4, 2)
    of_arcs = outside_known(space.radii, twists, 0.2)
    np.testing.assert_array_equal(grown.radii[0], of_arcs[0])
    np.testing.assert_array_equal(grown.radii[1], np.maximum(of_arcs[0], of_arcs[1]))
    np.testing.assert_array_equal(grown.radii[2], np.maximum(of_arcs[1], of_arcs[2]))
    np.testing.assert_array_equal(grown.radii[3], of_arcs[2])
    outer = inside_known(11.0, twists, 0.2)
    np.testing.assert_array_equal(
        grown.annulus.outer, [outer[0], outer[:2].min(), outer[1:].min(), outer[2]]
    )
    assert grown.at(np.zeros((4, 3))).shape == (4, 4)


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
