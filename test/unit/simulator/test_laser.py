"""The simulated scanner: rays, where its beams start, what is random, and ranges of REP 117."""

import dataclasses
import math
import pickle

import numpy as np
import pytest

from cmpsp_ros.simulator import Laser, LaserSettings, Motion, cast, discs_of, edges_of
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, Obstacle, convex
from cmpsp_ros.world.roads import OpenFloor

MS = 1_000_000
NOTHING = np.empty((0, 4)), np.empty((0, 5))
WALL = np.array([[2.0, -50.0, 2.0, 50.0]]), np.empty((0, 5))
PLAIN = LaserSettings(rate=10.0, angle_min=-0.5, angle_max=0.5, count=5, range_max=10.0)


def motion(stamp_ns, pose, twist=(0.0, 0.0)):
    return Motion(stamp_ns, np.array(pose, dtype=float), np.zeros(2), np.array(twist, dtype=float))


def laser(*motions, **changes):
    made = Laser(dataclasses.replace(PLAIN, **changes), 0)
    made.note(*(motions or [motion(0, (0.0, 0.0, 0.0))]))
    return made


def test_ranges_to_a_wall():
    scan = laser().scan(*WALL)
    assert scan.stamp_ns == 0
    assert np.allclose(scan.ranges, 2.0 / np.cos([-0.5, -0.25, 0.0, 0.25, 0.5]), atol=1e-12)


def test_the_scanner_is_where_it_is_mounted():
    # Half a metre ahead of the robot, turned left, on a robot that is turned left, too.
    mounted = laser(motion(0, (1.0, 0.0, math.pi / 2.0)), pose=(0.5, 0.0, math.pi / 2.0))
    ceiling = np.array([[-3.0, -50.0, -3.0, 50.0]]), np.empty((0, 5))
    assert mounted.scan(*ceiling).ranges[2] == pytest.approx(4.0)
    mounted = laser(motion(0, (1.0, 0.0, math.pi / 2.0)), pose=(0.5, 0.0, -math.pi / 2.0))
    assert mounted.scan(*WALL).ranges[2] == pytest.approx(1.0)


def test_scans_are_due_at_their_rate_when_their_last_beam_is():
    made = laser(time_increment=0.01)
    assert not made.is_due(40 * MS - 1)
    assert made.is_due(40 * MS)
    made.scan(*NOTHING)
    assert not made.is_due(140 * MS - 1)
    assert made.is_due(140 * MS)
    assert made.scan(*NOTHING).stamp_ns == 100 * MS


def test_each_beam_starts_from_the_pose_of_its_time():
    # Ahead at 1 m/s for 20 ms, then at rest.
    moving = motion(0, (0.0, 0.0, 0.0), (1.0, 0.0)), motion(20 * MS, (0.02, 0.0, 0.0))
    scan = laser(*moving, time_increment=0.01).scan(*WALL)
    driven = np.array([0.0, 0.01, 0.02, 0.02, 0.02])
    assert np.allclose(scan.ranges, (2.0 - driven) / np.cos(np.linspace(-0.5, 0.5, 5)), atol=1e-12)
    # Turning as the beams do, but the other way: all look ahead.
    turning = motion(0, (0.0, 0.0, 0.5), (0.0, -25.0))
    assert np.allclose(laser(turning, time_increment=0.01).scan(*WALL).ranges, 2.0, atol=1e-12)


def test_motion_before_a_scan_is_forgotten_and_motion_during_it_is_not():
    made, sizes = laser(time_increment=0.01), []
    for k in range(1, 1000):
        made.note(motion(k * MS, (1e-3 * k, 0.0, 0.0), (1.0, 0.0)))
        if made.is_due(k * MS):
            driven = 1e-9 * (made.next_ns + 10 * MS * np.arange(5))
            expected = (2.0 - driven) / np.cos(np.linspace(-0.5, 0.5, 5))
            assert np.allclose(made.scan(*WALL).ranges, expected, atol=1e-12)
        sizes.append(len(pickle.dumps(made)))
    assert max(sizes[500:]) <= max(sizes[:300])


def test_ranges_out_of_range_are_those_of_rep_117():
    near, far = laser(range_min=2.1), laser(range_max=2.1)
    assert near.scan(*WALL).ranges.tolist()[1:4] == [-math.inf] * 3
    assert far.scan(*WALL).ranges.tolist()[::4] == [math.inf] * 2
    assert laser().scan(*NOTHING).ranges.tolist() == [math.inf] * 5


def test_noise_and_losses_have_streams_of_their_own():
    count = 10_000
    shape = {'count': count, 'angle_min': -1e-6, 'angle_max': 1e-6}
    noisy = laser(**shape, stddev=0.01).scan(*WALL).ranges
    assert np.std(noisy) == pytest.approx(0.01, rel=0.05)
    lossy = laser(**shape, stddev=0.01, dropout=0.1, missed_return=0.2).scan(*WALL).ranges
    nan, infinite = np.isnan(lossy), np.isinf(lossy)
    assert nan.mean() == pytest.approx(0.1, abs=0.01)
    assert infinite.mean() == pytest.approx(0.2 * 0.9, abs=0.01)
    assert np.array_equal(lossy[~nan & ~infinite], noisy[~nan & ~infinite])


def test_a_reset_begins_all_that_is_random_again():
    made = laser(stddev=0.01, dropout=0.3)
    first = made.scan(*WALL).ranges
    assert not np.array_equal(made.scan(*WALL).ranges, first, equal_nan=True)
    made.reset(333)
    made.note(motion(333, (0.0, 0.0, 0.0)))
    again = made.scan(*WALL)
    assert again.stamp_ns == 333
    assert np.array_equal(again.ranges, first, equal_nan=True)
    other = laser(stddev=0.01, dropout=0.3, seed=1)
    assert not np.array_equal(other.scan(*WALL).ranges, first, equal_nan=True)


SQUARE = convex('box', [(2.0, -1.0), (4.0, -1.0), (4.0, 1.0), (2.0, 1.0)])
SHAPES = (
    Obstacle('disc', (-2.0, 1.0), 0.7),
    Capsule('wall', (-3.0, -2.0), (1.0, -3.0), 0.2),
    SQUARE,
    convex('wedge', [(-0.5, 2.0), (1.5, 2.5), (0.3, 4.0)]),
)


def ranges(shapes, rays, times=None, moving=(), lines=()):
    rays = np.array(rays, dtype=float)
    found = np.empty(len(rays))
    discs = np.vstack([discs_of(shapes), np.reshape(moving, (-1, 5))])
    cast(
        found, rays, np.zeros(len(rays)) if times is None else times, edges_of(shapes, lines), discs
    )
    return found


@pytest.mark.parametrize('seed', range(5))
def test_rays_end_on_the_first_shape(seed):
    random = np.random.default_rng(seed)
    rays = np.column_stack(
        [random.uniform(-1.0, 1.0, (400, 2)), random.uniform(-math.pi, math.pi, 400)]
    )
    found = ranges(SHAPES, rays)
    hits = np.isfinite(found)
    assert 100 < hits.sum() < 400
    ahead = np.column_stack([np.cos(rays[:, 2]), np.sin(rays[:, 2])])
    space = FreeSpace.of(OpenFloor(), SHAPES, 0.0)

    def clearance(lengths):
        points = rays[:, :2] + lengths[:, None] * ahead
        poses = np.column_stack([points, np.zeros(len(points))])
        return space.along(poses, np.zeros((len(poses), 2)), np.ones(len(poses)))

    at_end = clearance(np.where(hits, found, 0.0)).min(axis=1)
    assert np.abs(at_end[hits]).max() < 1e-4
    reach = np.where(hits, found, 12.0)
    for part in np.linspace(0.0, 0.999, 100):
        assert clearance(part * reach).min() > -1e-4


def test_a_capsule_without_a_length_is_a_disc():
    rays = [(-3.0, y, 0.0) for y in np.linspace(-0.6, 0.6, 13)]
    point = Capsule('point', (1.0, 0.0), (1.0, 0.0), 0.5)
    assert np.array_equal(ranges([point], rays), ranges([Obstacle('disc', (1.0, 0.0), 0.5)], rays))


def test_no_ray_slips_through_a_corner():
    # From afar, exactly through corners, where rounding may favour neither edge.
    random = np.random.default_rng(0)
    for turn in random.uniform(-math.pi, math.pi, 1000):
        around = turn + np.array([0.0, 2.0, 4.0])
        corners = [(math.cos(each), math.sin(each)) for each in around]
        x, y = corners[0]
        ray = [(4.0 * x, 4.0 * y, math.atan2(-y, -x))]
        assert ranges((convex('any', corners),), ray) == pytest.approx([3.0], abs=1e-6)


def test_a_disc_is_met_where_it_is_at_the_time_of_the_ray():
    rays = [(0.0, 0.0, 0.0)] * 3
    # Comes at 1 m/s, and is 3 m away at time 0.
    found = ranges((), rays, np.array([0.0, 1.0, 2.5]), [3.0, 0.0, -1.0, 0.0, 0.5])
    assert found == pytest.approx([2.5, 1.5, 0.0])
    assert ranges((), [(0.0, 0.0, math.pi)], None, [3.0, 0.0, 0.0, 0.0, 0.5]) == [math.inf]


def test_lines_are_walls_from_both_sides():
    line = np.array([[1.0, -1.0], [1.0, 1.0], [3.0, 1.0]])
    rays = [(0.0, 0.5, 0.0), (2.0, 0.5, math.pi), (2.0, 0.0, math.pi / 2.0), (0.0, 1.5, 0.0)]
    assert ranges((), rays, lines=[line]) == pytest.approx([1.0, 1.0, 1.0, math.inf])


def test_without_anything_to_see_ranges_are_infinite():
    assert ranges((), [(0.0, 0.0, 0.0)]) == [math.inf]
