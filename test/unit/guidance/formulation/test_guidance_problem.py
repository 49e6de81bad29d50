"""The robot's problem: its derivatives, and its solution against an independent solver's."""

import casadi
import numpy as np
import pytest
from problems import assert_derivatives, differences

from cmpsp_ros.guidance import Weights
from cmpsp_ros.guidance.formulation import GuidanceProblem
from cmpsp_ros.guidance.formulation.guidance_problem import N_EDGE_CONSTRAINTS
from cmpsp_ros.mpsp import Options
from cmpsp_ros.mpsp.qp.curvature import nearest_positive_semidefinite
from cmpsp_ros.mpsp.results import Status
from cmpsp_ros.mpsp.sqp.solve import solve
from cmpsp_ros.robots import Ackermann, DifferentialDrive, Omnidirectional
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import FAR, Annulus, Corridor, OpenFloor

KINDS = ('gauss_newton', 'projected', 'exact')
BENT = Corridor(((-2.0, -9.5), (4.0, -9.0), (9.0, -5.0), (10.0, 2.0)), (2.0,) * 4, (2.0,) * 4)
OBSTACLES = (Obstacle('a', (8.0, -6.0), 0.7), Obstacle('b', (10.0, -2.0), 0.5))


def problem(cost, obstacles=(), robot=None, steps=50, road=None, y=-9.25):
    return GuidanceProblem(
        robot or DifferentialDrive(),
        FreeSpace.of(road or Annulus(), obstacles, 0.0),
        cost,
        np.array([0.0, y, 0.0]),
        np.array([10.0, 0.0]),
        np.full(steps, 10.0 / steps),
    )


def options(posed, **changes):
    path = posed.size.path
    return Options(
        np.full(2, 1e3), np.full(path, 1e4), trust_radius=np.array([9.0, 9.0, 0.6]), **changes
    )


@pytest.mark.parametrize('kind', KINDS)
def test_derivatives(kind):
    posed = problem(Weights(15.0, 2.0, 0.3), OBSTACLES, steps=6)
    rng = np.random.default_rng(0)
    U = np.array([45.0, 44.5]) + 0.5 * rng.normal(size=(7, 2))
    assert_derivatives(posed, U, atol=2e-6)
    lin = posed.linearise(posed.predict(U), U, kind)
    np.testing.assert_array_equal(lin.L_UU, np.tile(2.3 * np.eye(2), (7, 1, 1)))


CROSSED = Omnidirectional.mecanum(0.1, 0.15, max_wheel_speed=60.0, max_lateral_acceleration=0.5)
LIMITED = (
    DifferentialDrive(max_lateral_acceleration=0.5),
    CROSSED,
    Ackermann(wheel_base=0.3, max_steering_angle=0.5, max_lateral_acceleration=0.5),
)


@pytest.mark.parametrize('robot', LIMITED, ids=['differential', 'mecanum', 'car'])
@pytest.mark.parametrize('sign', [1.0, -1.0], ids=['ahead', 'back'])
def test_derivatives_of_the_lateral_acceleration(robot, sign):
    posed = problem(Weights(15.0, 2.0, 0.3), OBSTACLES, robot, steps=6)
    U = np.full((7, robot.n_controls), sign * 3.0) + np.random.default_rng(0).normal(
        size=(7, robot.n_controls)
    )
    U[:, robot.n_speeds :] *= 0.1
    assert_derivatives(posed, U, atol=2e-6)
    rows = posed.evaluate(posed.predict(U), U).g[:-1, -2:]
    found = robot.lateral_acceleration(U[:-1])
    np.testing.assert_allclose(rows.max(axis=1), found - 0.99 * 0.5, atol=1e-12)


@pytest.mark.parametrize('road', [Annulus(), OpenFloor(), BENT], ids=['ring', 'floor', 'bent'])
def test_derivatives_of_several_discs(road):
    """Each disc has its rows, which depend on the heading unless it is at the reference point."""
    discs = np.array([[0.0, 0.0], [0.6, 0.0], [-0.4, 0.3]])
    whole = FreeSpace.of(road, OBSTACLES, 0.2, discs)
    cost, pose, goal = Weights(15.0, 2.0, 0.3), np.array([0.0, -9.25, 0.3]), np.array([10.0, 0.0])
    posed = GuidanceProblem(DifferentialDrive(), whole, cost, pose, goal, np.full(6, 0.5))
    assert posed.size.path == 3 * (2 + len(OBSTACLES))
    U = np.array([45.0, 44.5]) + 0.5 * np.random.default_rng(0).normal(size=(7, 2))
    assert_derivatives(posed, U, atol=5e-6)
    X = posed.predict(U)
    g = posed.evaluate(X, U).g.reshape(7, 3, -1)[1:]
    clearance = np.minimum(-g, FAR)
    np.testing.assert_allclose(clearance.min(axis=1), whole.at(X)[1:], atol=1e-9)
    for i in range(3):
        alone = FreeSpace.of(road, OBSTACLES, 0.2, discs[i : i + 1])
        np.testing.assert_allclose(clearance[:, i], alone.at(X)[1:], atol=1e-9)


@pytest.mark.parametrize('radius', [7.0, 10.0])
def test_exact_hessian_is_the_second_derivative_inside_and_outside_the_centre_line(radius):
    road = Annulus(inner_radius=2.0 * radius - 11.0)
    posed = problem(Weights(15.0, 2.0, 0.3), OBSTACLES, road=road, steps=6)
    U = np.array([45.0, 44.8]) + 0.1 * np.random.default_rng(1).normal(size=(7, 2))
    inside = np.linalg.norm(posed.predict(U)[:, :2], axis=1) < radius
    assert inside.any() == (radius == 10.0)
    assert_derivatives(posed, U, 'exact', proximal=2.0, atol=2e-5)


def test_projected_hessian_is_the_positive_part_of_the_exact_one():
    posed = problem(Weights(15.0, 0.0, 0.0), steps=6)
    U = np.tile([45.0, 44.8], (7, 1))
    X = posed.predict(U)
    inside = np.linalg.norm(X[:, :2], axis=1) < 10.0
    assert inside.any()
    assert not inside.all()
    exact, projected, plain = (
        posed.linearise(X, U, kind).L_XX for kind in ('exact', 'projected', 'gauss_newton')
    )
    np.testing.assert_array_equal(projected[inside], plain[inside])
    np.testing.assert_array_equal(projected[~inside], exact[~inside])
    assert np.linalg.eigvalsh(exact[inside]).min(axis=1).max() < 0.0
    for kind in (projected, plain):
        assert np.linalg.eigvalsh(kind).min() >= -1e-12
    np.testing.assert_allclose(projected, nearest_positive_semidefinite(exact), atol=1e-12)


def test_gauss_newton_is_what_remains_of_the_second_derivative_on_the_centre_line():
    posed = problem(Weights(15.0, 0.0, 0.0), road=Annulus(inner_radius=7.5), steps=1)
    U = np.zeros((2, 2))
    X = posed.predict(U)

    def slope(at):
        return posed.linearise(at, U).L_X

    second = differences(slope, X)
    np.testing.assert_allclose(posed.linearise(X, U).L_XX[0], second[0, :, 0], atol=1e-5)


def test_cost_is_that_of_equation_95():
    posed = problem(Weights(15.0, 3.0, 0.2), steps=4)
    U = np.arange(10.0).reshape(5, 2)
    X = posed.predict(U)
    radius = np.linalg.norm(X[:, :2], axis=1)
    by_hand = 7.5 * ((radius - 10.0) ** 2).sum() + 0.1 * (U**2).sum()
    assert posed.evaluate(X, U).cost == pytest.approx(by_hand, rel=1e-14)


def test_constraints_are_clearances_and_stage_0_has_none():
    posed = problem(Weights(15.0, 1.0, 0.0), OBSTACLES, steps=4)
    assert posed.size.path == N_EDGE_CONSTRAINTS + 2
    U = np.tile([45.0, 44.0], (5, 1))
    X = posed.predict(U)
    g = posed.evaluate(X, U).g
    assert (g[0] == -np.inf).all()
    for k in range(1, 5):
        radius = np.linalg.norm(X[k, :2])
        assert g[k, 0] == pytest.approx(radius - 11.0)
        assert g[k, 1] == pytest.approx(9.0 - radius)
        for index, obstacle in enumerate(OBSTACLES):
            away = np.linalg.norm(X[k, :2] - obstacle.center)
            assert g[k, N_EDGE_CONSTRAINTS + index] == pytest.approx(obstacle.radius - away)


def test_limits():
    posed = problem(Weights(15.0, 1.0, 0.0), robot=DifferentialDrive(max_wheel_speed=51.0))
    np.testing.assert_array_equal(posed.control_upper, np.full((51, 2), 51.0))
    np.testing.assert_array_equal(posed.control_lower, np.full((51, 2), -51.0))
    free = problem(Weights(15.0, 1.0, 0.0))
    assert np.isinf(free.control_upper).all()


@pytest.mark.parametrize('kind', KINDS)
def test_at_the_centre_of_the_road_everything_is_finite(kind):
    posed = GuidanceProblem(
        DifferentialDrive(),
        FreeSpace.of(Annulus(), (Obstacle('here', (0.0, 0.0), 0.5),), 0.0),
        Weights(15.0, 1.0, 0.0),
        np.zeros(3),
        np.zeros(2),
        np.full(3, 0.2),
    )
    U = np.zeros((4, 2))
    lin = posed.linearise(posed.predict(U), U, kind)
    lin.check(posed.size)
    assert kind == 'exact' or np.linalg.eigvalsh(lin.L_XX).min() >= -1e-9
    found = solve(posed, U, options(posed, hessian=kind), 10)
    assert found.status is not Status.NOT_FINITE


@pytest.mark.parametrize('steps', [1, 2])
def test_shortest_horizons(steps):
    posed = GuidanceProblem(
        DifferentialDrive(max_wheel_speed=51.0),
        FreeSpace.of(Annulus(), OBSTACLES, 0.0),
        Weights(15.0, 1.0, 0.0),
        np.array([9.9, -0.4 * steps, 1.5]),
        np.array([10.0, 0.0]),
        np.full(steps, 0.25),
    )
    found = solve(posed, np.full((steps + 1, 2), 40.0), options(posed), 30)
    np.testing.assert_allclose(found.iterate.X[-1, :2], [10.0, 0.0], atol=1e-8)


def best(posed, U, cost, road, limit=np.inf, obstacles=()):
    """The least cost by an interior-point solver, with the same arcs and constraints."""
    steps = posed.size.horizon
    robot, opti = DifferentialDrive(), casadi.Opti()
    X, V = opti.variable(3, steps + 1), opti.variable(2, steps + 1)
    length = 10.0 / steps * robot.wheel_radius / 2.0 * (V[0, :] + V[1, :])
    turn = 10.0 / steps * robot.wheel_radius / (2.0 * robot.half_track) * (V[0, :] - V[1, :])
    half = turn / 2.0
    # The chord's share of the arc; by its series, which is good to 1e-15 at these half angles.
    share = 1.0 - half**2 / 6.0 + half**4 / 120.0 - half**6 / 5040.0 + half**8 / 362880.0
    opti.subject_to(X[:, 0] == casadi.DM(posed.predict(U)[0]))
    for k in range(steps):
        course, chord = X[2, k] + half[k], length[k] * share[k]
        opti.subject_to(X[0, k + 1] == X[0, k] + chord * casadi.cos(course))
        opti.subject_to(X[1, k + 1] == X[1, k] + chord * casadi.sin(course))
        opti.subject_to(X[2, k + 1] == X[2, k] + turn[k])
    radius = casadi.sqrt(X[0, :] ** 2 + X[1, :] ** 2)
    opti.subject_to(opti.bounded(road.inner_radius, radius[1:].T, road.outer_radius))
    for obstacle in obstacles:
        x, y = X[0, 1:] - obstacle.center[0], X[1, 1:] - obstacle.center[1]
        opti.subject_to(obstacle.radius**2 <= (x**2 + y**2).T)
    opti.subject_to(X[:2, -1] == casadi.DM([10.0, 0.0]))
    if np.isfinite(limit):
        opti.subject_to(opti.bounded(-limit, casadi.vec(V), limit))
    opti.minimize(
        0.5 * cost.road_center * casadi.sumsqr(radius - road.center_radius)
        + 0.5 * cost.control_effort * casadi.sumsqr(V)
    )
    opti.set_initial(V, U.T)
    opti.set_initial(X, posed.predict(U).T)
    quiet = {
        'print_level': 0,
        'sb': 'yes',
        'tol': 1e-11,
        'bound_relax_factor': 0.0,
        'mu_init': 1e-5,
        'bound_push': 1e-6,
        'bound_frac': 1e-6,
        'slack_bound_push': 1e-6,
        'slack_bound_frac': 1e-6,
    }
    opti.solver('ipopt', {'print_time': False}, quiet)
    answer = opti.solve()
    return float(answer.value(opti.f)), answer.value(V).T


@pytest.mark.parametrize(
    ('cost', 'limit', 'obstacles'),
    [
        (Weights(15.0, 0.1, 0.02), np.inf, ()),
        (Weights(15.0, 0.2, 0.02), np.inf, OBSTACLES),
        (Weights(15.0, 0.2, 0.02), 48.0, OBSTACLES),
    ],
)
@pytest.mark.parametrize('kind', KINDS)
def test_solution_is_that_of_an_independent_solver(cost, limit, obstacles, kind):
    road = Annulus()
    posed = problem(cost, obstacles, DifferentialDrive(max_wheel_speed=limit), road=road)
    start = np.tile([45.13, 44.63], (51, 1))
    found = solve(posed, start, options(posed, hessian=kind), 1000)
    assert found.status is Status.CONVERGED
    iterate = found.iterate
    assert np.linalg.norm(iterate.evaluation.output_error) < 1e-8
    assert iterate.evaluation.g.max() < 1e-8
    least, _ = best(posed, iterate.U, cost, road, limit, obstacles)
    assert iterate.evaluation.cost == pytest.approx(least, rel=1e-6)


def test_derivatives_beside_a_map():
    cells = np.zeros((60, 80), np.uint8)
    cells[20:26, 30:34] = cells[40:, 50:52] = 1
    grid = GridObstacle('map', OccupancyGrid((-1.0, -2.5, 0.3), 0.1, cells))
    posed = problem(Weights(15.0, 2.0, 0.3), (*OBSTACLES, grid), road=OpenFloor(), steps=6, y=-1.0)
    U = np.array([20.0, 19.0]) + 0.5 * np.random.default_rng(0).normal(size=(7, 2))

    assert posed.size.path == N_EDGE_CONSTRAINTS + 3
    assert_derivatives(posed, U, atol=1e-5)
