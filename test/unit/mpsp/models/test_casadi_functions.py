"""Problems from CasADi expressions against the same problems from functions and by hand."""

import builtins

import casadi
import numpy as np
import pytest
from problems import VanDerPol, assert_derivatives, assert_same_problem

from cmpsp_ros.mpsp import Options, ProblemError, Status, from_casadi, from_functions, solve

KINDS = ('exact', 'projected', 'gauss_newton')


def van_der_pol(kind=casadi.SX, horizon=8, **changes):
    x, u = kind.sym('x', 2), kind.sym('u', 1)
    pull = (1.0 - x[0] ** 2) * x[1] - x[0] + u
    given = {
        'horizon': horizon,
        'x0': [1.0, 0.5],
        'x': x,
        'u': u,
        'F': [x[0] + 0.1 * x[1], x[1] + 0.1 * pull],
        'L': 0.5 * (casadi.sumsqr(x) + u**2) + 0.25 * x[0] ** 2 * u**2,
        'h': x,
        'target': [0.0, 0.0],
        'g': [-0.5 - x[1], x[0] + u - 2.0],
    }
    changes = {
        name: change(x, u) if callable(change) else change for name, change in changes.items()
    }
    return from_casadi(**given | changes)


@pytest.mark.parametrize('kind', [casadi.SX, casadi.MX])
def test_nonlinear_problem_is_the_one_written_by_hand(kind):
    U = 0.3 * np.random.default_rng(0).normal(size=(9, 1))
    found = van_der_pol(kind)
    assert_same_problem(found, VanDerPol(horizon=8, floor=-0.5, mixed=2.0), U, KINDS, 1e-12)
    assert_derivatives(found, U, 'exact')


@pytest.mark.parametrize('kind', [casadi.SX, casadi.MX])
def test_residuals_and_cost_are_those_of_plain_functions(kind):
    """A bicycle-like problem with mixed constraints: the third way, from functions."""
    x, u, k = kind.sym('x', 3), kind.sym('u', 2), kind.sym('k')
    cos, sin, sqrt = casadi.cos, casadi.sin, casadi.sqrt
    symbolic = from_casadi(
        horizon=7,
        x0=[0.2, -1.0, 0.3],
        x=x,
        u=u,
        p=k,
        p_values=np.arange(8.0),
        F=[x[0] + 0.1 * u[0] * cos(x[2]), x[1] + 0.1 * u[0] * sin(x[2]), x[2] + 0.1 * u[1]],
        L=x[2] * u[1] + 0.1 * k * u[0] ** 2,
        residuals=[sqrt(1.0 + x[0] ** 2 + x[1] ** 2) - 2.0, 0.3 * u[0] * x[1]],
        h=[x[0] + u[1] ** 2, x[1]],
        target=[1.0, 1.0],
        g=[x[0] ** 2 - 4.0, u[0] * x[1] - 3.0, u[0] + u[1] - 5.0],
        lower=[-1.0, -2.0],
        upper=3.0,
    )

    def F(k, x, u):
        return [
            x[0] + 0.1 * u[0] * np.cos(x[2]),
            x[1] + 0.1 * u[0] * np.sin(x[2]),
            x[2] + 0.1 * u[1],
        ]

    plain = from_functions(
        horizon=7,
        x0=[0.2, -1.0, 0.3],
        controls=2,
        F=F,
        L=lambda k, x, u: x[2] * u[1] + 0.1 * k * u[0] ** 2,
        residuals=lambda k, x, u: [np.sqrt(1.0 + x[0] ** 2 + x[1] ** 2) - 2.0, 0.3 * u[0] * x[1]],
        h=lambda x, u: [x[0] + u[1] ** 2, x[1]],
        target=[1.0, 1.0],
        g=lambda k, x, u: [x[0] ** 2 - 4.0, u[0] * x[1] - 3.0, u[0] + u[1] - 5.0],
        lower=[-1.0, -2.0],
        upper=3.0,
    )
    assert symbolic.size == plain.size
    np.testing.assert_array_equal(symbolic.control_lower, plain.control_lower)
    np.testing.assert_array_equal(symbolic.control_upper, plain.control_upper)
    U = np.random.default_rng(2).normal(size=(8, 2))
    assert_same_problem(symbolic, plain, U, KINDS, 1e-7)
    assert (symbolic.evaluate(symbolic.predict(U), U).g[0] == -np.inf).tolist() == [
        True,
        False,
        False,
    ]
    # The two Hessians differ, or nothing was compared.
    X = plain.predict(U)
    exact, gauss_newton = (symbolic.linearise(X, U, kind).L_XX for kind in KINDS[::2])
    assert np.abs(exact - gauss_newton).max() > 0.1


@pytest.mark.parametrize('horizon', [1, 2, 15])
def test_without_constraints_of_any_kind(horizon):
    problem = van_der_pol(horizon=horizon, h=None, target=None, g=None)
    assert (problem.size.output, problem.size.path) == (0, 0)
    found = solve(problem, np.zeros((horizon + 1, 1)), Options(np.empty(0), np.empty(0)), 50)
    assert found.status is Status.CONVERGED
    plain = VanDerPol(horizon=horizon, passes=False)
    reference = solve(plain, np.zeros((horizon + 1, 1)), Options(np.empty(0), np.zeros(2)), 50)
    np.testing.assert_allclose(found.iterate.U, reference.iterate.U, atol=1e-6)


@pytest.mark.parametrize(
    ('changes', 'named'),
    [
        ({'horizon': 0}, 'horizon: found 0'),
        ({'x0': [1.0]}, 'x: found 2 components, wanted 1'),
        ({'x': 'x'}, "x: found 'x', wanted a symbol, SX or MX"),
        ({'u': lambda x, u: 2.0 * u}, 'u: found SX.*, wanted a symbol'),
        ({'u': casadi.SX.sym('u', 1, 2)}, r'u: found shape \(1, 2\), wanted a column'),
        ({'F': lambda x, u: x[0]}, r'F: found shape \(1, 1\), wanted \(2, 1\)'),
        ({'F': lambda x, u: x.T}, r'F: found shape \(1, 2\), wanted a column'),
        ({'F': 'x'}, "F: found 'x', wanted an expression in x, u and p"),
        ({'L': lambda x, u: x}, r'L: found shape \(2, 1\), wanted \(1, 1\)'),
        ({'L': None}, 'L: found none and no residuals'),
        ({'g': [casadi.SX.sym('y')]}, 'g: found a symbol other than x, u and p'),
        ({'g': [casadi.MX.sym('y')]}, 'g: found .*, wanted an expression .* of the same kind as x'),
        ({'target': None}, 'target: found none with an h'),
        ({'h': None}, 'h: found none with a target'),
        ({'lower': 1.0, 'upper': 0.0}, r'lower: found 1.0 at \[0, 0\]'),
        ({'upper': [[1.0]]}, r'upper: found shape \(1, 1\), wanted \(1,\) or \(9, 1\)'),
        ({'p_values': np.zeros(9)}, 'p: found none with p_values'),
        ({'p': casadi.SX.sym('p')}, r'p_values: found shape \(9, 0\), wanted \(9, 1\)'),
        ({'p': casadi.SX.sym('p'), 'p_values': np.zeros(8)}, r'p_values: found shape \(8,\)'),
        ({'applies': [True]}, r'applies: found shape \(1,\), wanted \(9, 2\)'),
    ],
)
def test_bad_input_is_named(changes, named):
    with pytest.raises(ProblemError, match=f'^{named}'):
        van_der_pol(**changes)


def test_unknown_hessian_and_derivatives_that_are_not_finite_are_named():
    problem = van_der_pol(L=lambda x, u: casadi.sumsqr(x) + casadi.sqrt(u - 1.0))
    U = np.zeros((9, 1))
    X = problem.predict(U)
    with pytest.raises(ProblemError, match=r'^L_U: found (nan|inf) at stage 0, component 0'):
        problem.linearise(X, U)
    with pytest.raises(ProblemError, match="hessian: found 'newton'"):
        problem.linearise(X, U, 'newton')
    problem.linearise(X, U + 2.0)
    assert np.isnan(problem.linearise(X, U).L_U).all()


def test_constraints_apply_where_the_caller_says():
    applies = np.arange(18).reshape(9, 2) % 3 > 0
    problem = van_der_pol(applies=applies)
    g = problem.evaluate(problem.predict(np.zeros((9, 1))), np.zeros((9, 1))).g
    # The first one is of the state alone, which is known at stage 0.
    applies[0, 0] = False
    np.testing.assert_array_equal(g != -np.inf, applies)


def test_without_casadi_the_extra_is_named(monkeypatch):
    imported = builtins.__import__

    def without(name, *rest, **more):
        if name == 'casadi':
            raise ImportError(name)
        return imported(name, *rest, **more)

    monkeypatch.setattr(builtins, '__import__', without)
    with pytest.raises(ImportError, match=r"extra 'casadi': pip install 'cmpsp_ros\[casadi\]'"):
        van_der_pol()
