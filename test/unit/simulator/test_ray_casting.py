"""Ranges are those of shapes: no ray passes through one, and none ends before one."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cmpsp_ros.simulator import cast, discs_of, edges_of
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule, Obstacle, convex
from cmpsp_ros.world.roads import OpenFloor

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
