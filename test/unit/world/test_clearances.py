"""The sweep of the plan check and the rows of the solver against `geometry`, which shares no code.

Every kind of road, obstacle, footprint and robot. Both may be closer to things than they are where
they are bounds (a corridor's edges, cells, paths that are no chords), but never farther.
"""

import math

import geometry as dense
import numpy as np
import pytest

from cmpsp_ros.guidance import Weights
from cmpsp_ros.guidance.formulation import GuidanceProblem
from cmpsp_ros.guidance.safety.plan_sweep import SWEEP, PlanSweep, sweep_plan
from cmpsp_ros.robots import (
    Ackermann,
    CustomRobot,
    DifferentialDrive,
    Footprint,
    Omnidirectional,
    covered,
)
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import SHAPES as TYPES
from cmpsp_ros.world.obstacles import Capsule, MovingDiscs, Obstacle, convex
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor

DURATIONS = np.array([0.3, 0.2, 0.4])
BODY = ((-0.3, -0.2), (0.9, -0.2), (0.9, 0.25), (-0.3, 0.2))
LINE = ((-3.0, -0.4), (-1.0, 0.1), (1.0, 0.0), (3.0, 0.6), (5.0, 0.5))
RING = ((0.0, 0.0), (2.5, 0.8), (3.0, 3.2), (0.0, 5.0), (-3.0, 3.2), (-2.5, 0.8))
WIDTHS = (1.2, 1.2, 0.9, 1.4, 1.4)
CELLS = np.zeros((24, 28), np.uint8)
CELLS[12:14, 14:16] = CELLS[16, 19] = Cell.OCCUPIED
# All drives are inside: beyond a grid its distances are bounds that are much too low.
GRID = OccupancyGrid((-2.4, -3.6, 0.3), 0.25, CELLS)
CART, GROWTH = (1.5, 0.8, -0.4, -0.3, 0.2), 0.05


class Tricycle(CustomRobot):
    n_controls, n_speeds, turns_on_the_spot = 2, 1, False
    limits, change_limits, constants = (1.5, 1.2), (math.inf, math.inf), (0.8,)

    @staticmethod
    def motion(constants, speed, angle):
        return (
            speed * np.cos(angle),
            0.1 * speed * np.sin(angle),
            speed * np.sin(angle) / constants[0],
        )

    @staticmethod
    def steer(constants, forward, left, turn_rate):
        angle = math.atan2(constants[0] * turn_rate, forward)
        return forward / math.cos(angle), angle


# What is driven by a control, in the words of the model: forward, left, turning.
ROBOTS = {
    'differential': (
        DifferentialDrive(wheel_radius=0.05, half_track=0.2, max_wheel_speed=40.0),
        lambda u: (0.025 * (u[0] + u[1]), 0.0, 0.05 * (u[0] - u[1]) / 0.4),
        (30.0, 30.0),
    ),
    'car': (
        Ackermann(wheel_radius=0.1, wheel_base=0.5, max_steering_angle=0.6, max_wheel_speed=20.0),
        lambda u: (0.1 * u[0], 0.0, 0.1 * u[0] * math.tan(u[1]) / 0.5),
        (15.0, 0.6),
    ),
    'omnidirectional': (
        Omnidirectional.mecanum(0.15, 0.1, wheel_radius=0.05, max_wheel_speed=40.0),
        None,
        (15.0, 15.0, 15.0),
    ),
    'custom': (
        Tricycle.of({}),
        lambda u: (u[0] * math.cos(u[1]), 0.1 * u[0] * math.sin(u[1]), u[0] * math.sin(u[1]) / 0.8),
        (1.4, 1.1),
    ),
}
ROADS = {
    'annulus': (
        Annulus((0.0, -4.0), 3.0, 5.5),
        lambda points: dense.from_circles(points, (0.0, -4.0), 3.0, 5.5),
    ),
    'corridor': (
        Corridor(LINE, WIDTHS, WIDTHS[::-1]),
        lambda points: dense.from_corridor(points, LINE, WIDTHS, WIDTHS[::-1], closed=False),
    ),
    'ring': (
        Corridor(RING, (1.0,) * 6, (1.2,) * 6, closed=True),
        lambda points: dense.from_corridor(points, RING, (1.0,) * 6, (1.2,) * 6, closed=True),
    ),
    'open floor': (OpenFloor(), None),
}
SHAPES = {
    'disc': (
        Obstacle('disc', (1.0, -0.7), 0.3),
        lambda points: dense.from_disc(points, (1.0, -0.7), 0.3),
    ),
    'capsule': (
        Capsule('capsule', (-1.0, 0.8), (0.6, 1.0), 0.1),
        lambda points: dense.from_capsule(points, (-1.0, 0.8), (0.6, 1.0), 0.1),
    ),
    'polygon': (
        convex('polygon', [(0.9, 0.2), (1.6, 0.3), (1.3, 0.9)]),
        lambda points: dense.from_polygon(points, [(0.9, 0.2), (1.6, 0.3), (1.3, 0.9)]),
    ),
    'grid': (
        GridObstacle('grid', GRID, unknown_is_free=True),
        lambda points: dense.from_cells(points, GRID.origin, 0.25, CELLS == Cell.OCCUPIED),
    ),
}
GRID_PLACE = [*SHAPES].index('grid')
FOOTPRINTS = {'disc': (Footprint(), 0.25), 'polygon': covered(BODY)}


def twist_of(name, control):
    robot, motion, _ = ROBOTS[name]
    if motion is not None:
        return motion(control)
    # The three wheels whose speeds are controls roll on the floor without slip.
    rims = np.array([[1.0, -1.0, -0.25], [1.0, 1.0, 0.25], [1.0, -1.0, 0.25], [1.0, 1.0, -0.25]])
    return np.linalg.solve(rims[robot.driven] / 0.05, control)


def swept(robot, space, pose, controls, moving):
    """Least clearance of the whole plan from each edge, shape and moving disc."""
    found, count = np.zeros(1, SWEEP), 2 + len(space.radii) + len(moving)
    scratch = np.empty((2, count))
    legs = np.ascontiguousarray(moving.legs(DURATIONS))
    plan = np.vstack([controls, controls[-1:]])
    sweep_plan(
        found, scratch, pose, plan, DURATIONS, robot.kinematics, len(DURATIONS), True,
        space.data, legs, math.nan,
    )  # fmt: skip
    return scratch[0].copy(), PlanSweep(*found[0].item())


def drives(name, count):
    """Poses and controls of random drives."""
    random, (_, _, spread) = np.random.default_rng(5), ROBOTS[name]
    for _ in range(count):
        pose = np.array([*random.uniform([-0.6, -0.5], [0.4, 0.4]), random.uniform(-0.6, 0.6)])
        yield pose, random.uniform(-1.0, 1.0, (len(DURATIONS), len(spread))) * spread


def assert_bounds(found, known, radius, of_cells):
    """Clearances from shapes, one of which are cells: exact, or less than they are."""
    error = known - found
    allowed = np.full(error.shape, dense.DENSE)
    allowed[..., GRID_PLACE] = of_cells
    assert (error >= -dense.DENSE).all(), (found, known)
    # Cells have no depth here, and less than two of them away all is a bound.
    sure = np.ones(error.shape, dtype=bool)
    sure[..., GRID_PLACE] = known[..., GRID_PLACE] + radius > 2.0 * GRID.resolution
    assert (error <= allowed)[sure].all(), (found, known)


def assert_edges(road, found, known, radius):
    """Clearances from edges: a corridor's to a hundredth, and scaled where its width changes."""
    error, tolerance = known - found, 5e-3 + 0.011 * np.abs(known)
    assert (error >= -5e-3).all(), (found, known)
    allowed = tolerance + (1.0 - road.clearance_scale) * (known + radius)
    assert (error <= allowed).all(), (found, known)


def test_every_type_of_obstacle_is_among_them():
    assert {type(shape) for shape, _ in SHAPES.values()} >= {*TYPES}


@pytest.mark.parametrize('footprint', FOOTPRINTS)
@pytest.mark.parametrize('robot', ROBOTS)
@pytest.mark.parametrize('road', ROADS)
def test_the_sweep_finds_what_a_dense_drive_finds(road, robot, footprint):
    (of_road, from_edges), (body, radius) = ROADS[road], FOOTPRINTS[footprint]
    model, seen = ROBOTS[robot][0], np.zeros(3, dtype=int)
    shapes, distances = zip(*SHAPES.values(), strict=True)
    space = FreeSpace.of(of_road, shapes, radius, body.discs)
    cart = MovingDiscs(('cart',), np.array([[*CART, GROWTH, 0.0]]), np.zeros(1, np.int64)).grown(
        radius
    )
    for pose, controls in drives(robot, 3):
        found, result = swept(model, space, pose, controls, cart)
        twists = [twist_of(robot, each) for each in controls]
        times, poses = dense.driven(pose, twists, DURATIONS)
        discs = dense.placed(body.discs, poses)
        known = [each(discs).min() - radius for each in distances]
        known.append(dense.from_moving_disc(discs, times, CART, GROWTH).min() - radius)
        assert_bounds(found[2:], np.array(known), radius, 0.15)
        if from_edges is None:
            assert (found[:2] > 1e5).all()
        else:
            edges = np.array([each.min() - radius for each in from_edges(discs)])
            if (edges > -radius).all():
                assert_edges(of_road, found[:2], edges, radius)
                seen[0] += 1
        assert result.worst == found.min()
        assert result.edges == found[:2].min()
        assert result.others == found[2:].min()
        seen[1 + int(result.worst > 0.0)] += 1
        # All of a polygon is inside its discs.
        if body.corners:
            around = dense.placed(dense.outline(BODY), poses[::20])
            least = found[2 : 2 + len(SHAPES)].min()
            assert min(each(around).min() for each in distances) >= least - dense.DENSE
    assert seen[1] > 0
    assert seen[0] > 0 or from_edges is None


@pytest.mark.parametrize('footprint', FOOTPRINTS)
@pytest.mark.parametrize('road', ROADS)
def test_rows_of_the_solver_are_clearances_at_samples(road, footprint):
    (of_road, from_edges), (body, radius) = ROADS[road], FOOTPRINTS[footprint]
    shapes, distances = zip(*SHAPES.values(), strict=True)
    space = FreeSpace.of(of_road, shapes, radius, body.discs)
    robot, count = ROBOTS['differential'][0], len(body.discs)
    for pose, controls in drives('differential', 12):
        weights = Weights()
        problem = GuidanceProblem(robot, space, weights, pose, np.zeros(2), DURATIONS)
        U = np.vstack([controls, controls[-1:]])
        X = problem.predict(U)
        rows = -problem.evaluate(X, U).g[1:].reshape(len(DURATIONS), count, -1)
        discs = dense.placed(body.discs, X[1:])
        known = np.stack([each(discs) - radius for each in distances], axis=-1)
        assert_bounds(rows[..., 2:], known, radius, 0.3)
        if from_edges is None:
            assert np.isinf(rows[..., :2]).all()
            continue
        edges = np.stack(from_edges(discs), axis=-1) - radius
        on_road = (edges > -radius).all(axis=-1)
        assert_edges(of_road, rows[..., :2][on_road], edges[on_road], radius)
