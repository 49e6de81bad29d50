"""Problems from plain functions against the same problems written by hand."""

import math

import numpy as np
import pytest
from problems import VanDerPol, assert_derivatives, assert_same_problem

from cmpsp_ros.mpsp import Options, ProblemError, Status, from_functions, solve
from cmpsp_ros.mpsp.models.derivatives import StageFunction

SCHEMES = ('auto', 'complex_step', 'central')


def van_der_pol(horizon=8, **changes):
    """`VanDerPol` of the tests with a floor of -0.5 and a mixed constraint of 2."""

    def F(k, x, u):
        pull = (1.0 - x[0] ** 2) * x[1] - x[0] + u[0]
        return [x[0] + 0.1 * x[1], x[1] + 0.1 * pull]

    given = {
        'horizon': horizon,
        'x0': [1.0, 0.5],
        'controls': 1,
        'F': F,
        'L': lambda k, x, u: 0.5 * (x @ x + u @ u) + 0.25 * x[0] ** 2 * u[0] ** 2,
        'h': lambda x, u: x,
        'target': [0.0, 0.0],
        'g': lambda k, x, u: [-0.5 - x[1], x[0] + u[0] - 2.0],
    }
    return from_functions(**given | changes)


@pytest.mark.parametrize('derivatives', SCHEMES)
def test_nonlinear_problem_is_the_one_written_by_hand(derivatives):
    U = 0.3 * np.random.default_rng(0).normal(size=(9, 1))
    hand = VanDerPol(horizon=8, floor=-0.5, mixed=2.0)
    found = van_der_pol(derivatives=derivatives)
    assert_same_problem(found, hand, U, ('exact', 'projected', 'gauss_newton'), 1e-7)
    # Gradients, which are differenced for the Hessian, may be differences themselves.
    atol = 1e-4 if derivatives == 'central' else 1e-6
    assert_derivatives(found, U, 'exact', atol=atol)


def test_complex_step_is_exact_to_rounding():
    U = 0.3 * np.random.default_rng(2).normal(size=(9, 1))
    hand, found = VanDerPol(horizon=8), van_der_pol(derivatives='complex_step')
    X = hand.predict(U)
    for name in ('A', 'B', 'L_X', 'L_U'):
        arrays = (getattr(problem.linearise(X, U), name) for problem in (found, hand))
        np.testing.assert_allclose(*arrays, atol=1e-15, rtol=1e-14)


@pytest.mark.parametrize('derivatives', SCHEMES)
def test_residuals_give_the_gauss_newton_hessian(derivatives):
    def residuals(k, x, u):
        return np.array([x[0] * x[1] - 2.0 * k, u[0] + x[0] ** 2])

    problem = van_der_pol(L=None, residuals=residuals, derivatives=derivatives)
    U = 0.3 * np.random.default_rng(3).normal(size=(9, 1))
    X = problem.predict(U)
    assert_derivatives(problem, U, 'exact', atol=1e-3 if derivatives == 'central' else 1e-6)
    by_hand = sum(0.5 * (residuals(k, X[k], U[k]) ** 2).sum() for k in range(9))
    assert problem.evaluate(X, U).cost == pytest.approx(by_hand, rel=1e-14)
    lin, exact = (problem.linearise(X, U, kind) for kind in ('gauss_newton', 'exact'))
    (x, v), u = X.T, U[:, 0]
    ones, zeros = np.ones(9), np.zeros(9)
    R = np.array([[v, x, zeros], [2.0 * x, zeros, ones]]).transpose(2, 0, 1)
    joint = R.transpose(0, 2, 1) @ R
    np.testing.assert_allclose(lin.L_XX, joint[:, :2, :2], atol=1e-8)
    np.testing.assert_allclose(lin.L_UX, joint[:, 2:, :2], atol=1e-8)
    np.testing.assert_allclose(lin.L_UU, joint[:, 2:, 2:], atol=1e-8)
    first = x * v - 2.0 * np.arange(9)
    left_out = np.array([[2.0 * (u + x * x), first], [first, zeros]]).transpose(2, 0, 1)
    np.testing.assert_allclose(exact.L_XX - lin.L_XX, left_out, atol=1e-5)
    assert np.linalg.eigvalsh(exact.L_XX).min() < -0.1


def test_cost_and_residuals_add_and_only_the_cost_is_projected():
    parts = {'L': lambda k, x, u: -(x[0] ** 2), 'residuals': lambda k, x, u: [2.0 * x[0], u[0]]}
    both = van_der_pol(**parts)
    U = np.zeros((9, 1))
    X = both.predict(U)
    cost = both.evaluate(X, U).cost
    assert cost == pytest.approx((X[:, 0] ** 2).sum(), rel=1e-12)
    for kind, curvature in (('exact', 2.0), ('projected', 2.0), ('gauss_newton', 4.0)):
        lin = both.linearise(X, U, kind)
        np.testing.assert_allclose(lin.L_XX[:, 0, 0], curvature, atol=1e-6)
        np.testing.assert_allclose(lin.L_UU, 1.0, atol=1e-6)
    saddle = van_der_pol(L=parts['L'])
    for kind, curvature in (('exact', -2.0), ('projected', 0.0), ('gauss_newton', 0.0)):
        np.testing.assert_allclose(saddle.linearise(X, U, kind).L_XX[:, 0, 0], curvature, atol=1e-6)


@pytest.mark.parametrize(
    'awkward',
    [
        abs,
        lambda v: np.linalg.norm([v, 0.0]),
        lambda v: np.hypot(v, 1.0),
        lambda v: math.sqrt(1.0 + v**2),
        lambda v: float(v) ** 2,
        lambda v: np.array([v, 1.0], dtype=float)[0] ** 2,
    ],
)
def test_what_takes_no_complex_numbers_is_differenced(awkward):
    function = StageFunction('f', lambda k, x, u: awkward(x[0]) + u[0], 1, ())
    probes = [(0, np.array([0.3, 0.2])), (1, np.array([-0.4, 0.1]))]
    function.choose_scheme(probes)
    assert function.scheme == 'central'
    expected = (awkward(0.7 + 1e-6) - awkward(0.7 - 1e-6)) / 2e-6
    np.testing.assert_allclose(function.jacobian(0, np.array([0.7, 0.0])), [expected, 1.0], 1e-7)


def test_complex_step_needs_a_probe_where_the_function_is_finite():
    function = StageFunction('f', lambda k, x, u: np.log(x[0]) + u[0], 1, ())
    function.choose_scheme([(0, np.array([-1.0, 0.0]))])
    assert function.scheme == 'central'
    function.choose_scheme([(0, np.array([-1.0, 0.0])), (0, np.array([1.0, 0.0]))])
    assert function.scheme == 'complex_step'


def test_overflow_is_not_a_number_in_both_schemes_and_other_errors_pass_through():
    function = StageFunction('f', lambda k, x, u: 1.0 / complex(x[0]).real, 1, ())
    with pytest.raises(ZeroDivisionError):
        function(0, np.zeros(2))
    overflow = StageFunction('f', lambda k, x, u: [math.exp(1e3)], 1, (1,))
    for overflow.scheme in ('central', 'complex_step'):
        assert np.isnan(overflow.jacobian(0, np.zeros(2))).all()


def test_functions_may_work_in_place():
    def F(k, x, u):
        x += 0.1 * u
        return x

    problem = from_functions(horizon=2, x0=[1.0], controls=1, F=F, L=lambda k, x, u: u @ u)
    np.testing.assert_allclose(problem.predict(np.ones((3, 1)))[:, 0], [1.0, 1.1, 1.2])


@pytest.mark.parametrize('horizon', [1, 2, 15])
def test_without_constraints_of_any_kind(horizon):
    problem = van_der_pol(horizon, h=None, target=None, g=None)
    assert (problem.size.output, problem.size.path) == (0, 0)
    found = solve(problem, np.zeros((horizon + 1, 1)), Options(np.empty(0), np.empty(0)), 50)
    assert found.status is Status.CONVERGED
    U, X = found.iterate.U, found.iterate.X
    least = problem.evaluate(X, U).cost
    rng = np.random.default_rng(4)
    for _ in range(20):
        other = U + 1e-2 * rng.normal(size=U.shape)
        assert problem.evaluate(problem.predict(other), other).cost > least
    assert U[-1] == pytest.approx(0.0, abs=1e-9)


def test_shortest_horizons_reach_their_target():
    for horizon in (1, 2):
        problem = from_functions(
            horizon=horizon,
            x0=[1.0],
            controls=1,
            F=lambda k, x, u: x + u,
            L=lambda k, x, u: 0.5 * u @ u,
            h=lambda x, u: x,
            target=[3.0],
            g=lambda k, x, u: [x[0] - 10.0, u[0] - 5.0],
            upper=4.0,
        )
        options = Options(np.array([10.0]), np.full(2, 10.0))
        found = solve(problem, np.zeros((horizon + 1, 1)), options, 20)
        assert found.status is Status.CONVERGED
        np.testing.assert_allclose(found.iterate.U[:-1, 0], 2.0 / horizon, atol=1e-9)


def test_constraints_that_no_control_changes_do_not_apply_at_the_start():
    problem = van_der_pol(g=lambda k, x, u: [x[0] - 0.5, x[0] + u[0] - 2.0, -np.inf])
    U = np.zeros((9, 1))
    g = problem.evaluate(problem.predict(U), U).g
    assert g[0, 0] == -np.inf
    assert g[0, 1] == -1.0
    assert (g[:, 2] == -np.inf).all()
    assert np.isfinite(g[1:, :2]).all()


@pytest.mark.parametrize(
    ('bound', 'wanted'),
    [
        (None, np.full((3, 2), -np.inf)),
        (-1.0, np.full((3, 2), -1.0)),
        ([-1.0, -2.0], np.tile([-1.0, -2.0], (3, 1))),
        (np.arange(6.0).reshape(3, 2) - 6.0, np.arange(6.0).reshape(3, 2) - 6.0),
    ],
)
def test_bounds_of_every_shape(bound, wanted):
    problem = from_functions(
        horizon=2, x0=[0.0], controls=2, F=lambda k, x, u: x + u[0], L=lambda k, x, u: u @ u,
        lower=bound,
    )  # fmt: skip
    np.testing.assert_array_equal(problem.control_lower, wanted)
    assert np.isposinf(problem.control_upper).all()


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'horizon': 0}, 'horizon: found 0, wanted a whole number of at least 1'),
        ({'horizon': 2.5}, 'horizon: found 2.5'),
        ({'horizon': True}, 'horizon: found True'),
        ({'controls': 0}, 'controls: found 0'),
        ({'x0': [[1.0]]}, r'x0: found shape \(1, 1\), wanted a vector'),
        ({'x0': [1.0, np.nan]}, r'x0: found \[ 1\. nan\], wanted finite'),
        ({'x0': 'here'}, "x0: found 'here', wanted numbers"),
        ({'F': lambda k, x, u: x[:1]}, r'F: found shape \(1,\) at stage 0, wanted \(2,\)'),
        ({'F': lambda k, x, u: ['a', 'b']}, 'F: found .* at stage 0, wanted numbers'),
        ({'L': lambda k, x, u: x}, r'L: found shape \(2,\) at stage 0, wanted \(\)'),
        ({'L': None}, 'L: found none and no residuals'),
        ({'residuals': lambda k, x, u: 1.0}, r'residuals: found shape \(\), wanted a vector'),
        ({'h': None}, 'h: found none with a target'),
        ({'target': None}, r'target: found none with an h, wanted shape \(2,\)'),
        ({'target': [0.0]}, r'target: found shape \(1,\), wanted \(2,\)'),
        ({'target': [0.0, np.inf]}, 'target: found .*inf'),
        ({'lower': [1.0, 2.0]}, r'lower: found shape \(2,\), wanted \(1,\) or \(9, 1\)'),
        ({'lower': 'low'}, "lower: found 'low', wanted numbers"),
        ({'lower': np.nan}, r'lower: found nan at \[0, 0\]'),
        ({'upper': np.nan}, r'upper: found nan at \[0, 0\]'),
        (
            {'lower': 2.0, 'upper': 1.0},
            r'lower: found 2.0 at \[0, 0\], wanted a number below upper, which is 1.0',
        ),
        ({'lower': np.inf}, r'lower: found inf at \[0, 0\]'),
        ({'upper': -np.inf}, r'lower: found -inf at \[0, 0\]'),
        ({'derivatives': 'exact'}, "derivatives: found 'exact', wanted one of auto, complex"),
    ],
)
def test_bad_input_is_named(changes, named):
    with pytest.raises(ProblemError, match=f'^{named}'):
        van_der_pol(**changes)


def test_a_shape_that_changes_along_the_horizon_is_named():
    with pytest.raises(ProblemError, match=r'g: found shape \(2,\) at stage 8, wanted \(1,\)'):
        van_der_pol(g=lambda k, x, u: x[:1] if k < 8 else x)


def test_unknown_hessian_and_derivatives_that_are_not_finite_are_named():
    problem = van_der_pol(L=lambda k, x, u: x @ x + np.sqrt(u[0] - 1.0))
    U = np.zeros((9, 1))
    X = problem.predict(U)
    for kind in ('gauss_newton', 'exact', 'projected'):
        with pytest.raises(
            ProblemError, match=r'^L_X: found nan at stage 0, component 0, wanted finite numbers'
        ):
            problem.linearise(X, U, kind)
    with pytest.raises(ProblemError, match="hessian: found 'newton', wanted one of gauss_newton"):
        problem.linearise(X, U, 'newton')
    problem.linearise(X, U + 2.0)
    # Once it has been fine, what is not finite is the iteration's to judge.
    assert np.isnan(problem.linearise(X, U).L_U).all()
