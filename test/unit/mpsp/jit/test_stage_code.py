"""Machine code of CasADi's functions, against CasADi itself."""

import casadi
import numpy as np
import pytest

from cmpsp_ros.mpsp import from_casadi
from cmpsp_ros.mpsp.jit import StageCode

x, y = casadi.SX.sym('x'), casadi.SX.sym('y')
UNARY = (
    'sin', 'cos', 'tan', 'asin', 'acos', 'atan', 'sinh', 'cosh', 'tanh', 'asinh', 'acosh', 'atanh',
    'exp', 'log', 'log1p', 'expm1', 'sqrt', 'erf', 'ceil', 'floor', 'fabs', 'sign', 'logic_not',
)  # fmt: skip
BINARY = ('power', 'atan2', 'hypot', 'fmin', 'fmax', 'fmod', 'copysign', 'logic_and', 'logic_or')
EXPRESSIONS = {name: getattr(casadi, name)(x) for name in UNARY}
EXPRESSIONS |= {name: getattr(casadi, name)(x, y) for name in BINARY}
EXPRESSIONS |= {
    'arithmetic': (x + y) * (x - y) / (1.0 + x * x) - (-x) + 2.0 * y + 1.0 / y,
    'comparisons': (x < y) + 2.0 * (x <= y) + 4.0 * (x == y) + 8.0 * (x != y),
    'chosen': casadi.if_else(x < y, x**3, y**1.5),
}


@pytest.mark.parametrize('name', EXPRESSIONS)
@pytest.mark.parametrize('lanes', [1, 4])
def test_numbers_are_those_of_casadi(name, lanes):
    function = casadi.Function('f', [x, y], [EXPRESSIONS[name], x])
    X = np.array([0.3, -0.7, 0.9, 1.0, 0.0, -0.2, 1.5])[:, None]
    Y = np.array([0.3, 0.4, -2.0, 0.1, -0.0, 1.0, 3.0])[:, None]
    wanted = np.array([float(function(*pair)[0]) for pair in zip(X, Y, strict=True)])
    found, same = StageCode(function, lanes)(X, Y)
    np.testing.assert_allclose(found[:, 0], wanted, rtol=1e-15)
    assert (same == X).all()


def test_a_roll_out_takes_each_state_from_the_last():
    code = StageCode(casadi.Function('f', [x, y], [2.0 * x + y]), 1)
    assert code.roll_out(np.ones(1), np.array([[0.0], [1.0], [2.0]])).ravel().tolist() == [
        1.0, 2.0, 5.0, 12.0,
    ]  # fmt: skip


def test_a_function_too_long_is_left_to_casadi():
    z = casadi.SX.sym('z', 2)
    long = z
    for _ in range(5001):
        long = casadi.vertcat(long[0] + 1e-3 * long[1], long[1] - 1e-3 * casadi.sin(long[0]))
    with pytest.raises(NotImplementedError, match='operations'):
        StageCode(casadi.Function('f', [z], [long]))
    stated = {'horizon': 5, 'x0': [1.0, 0.0], 'x': z, 'L': z[0] ** 2}
    u = casadi.SX.sym('u')
    problem = from_casadi(**stated, u=u, F=long + u)
    U = np.zeros((6, 1))
    X = problem.predict(U)
    step = casadi.Function('step', [z], [long])
    np.testing.assert_array_equal(X[1], step(X[0]).full()[:, 0])
    np.testing.assert_allclose(problem.next_states(X, U), X[1:], rtol=1e-14)
    assert problem.linearise(X, U).A.shape == (5, 2, 2)
