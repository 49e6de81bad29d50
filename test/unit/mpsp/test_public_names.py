"""Names that a user imports from the method, and the packages that they need."""

import subprocess
import sys

import pytest

import cmpsp_ros.mpsp as method

# One step of the method without optional packages; None makes an import fail.
ALONE = """
import sys
for name in ('casadi', 'clarabel', 'daqp', 'qpsolvers', 'rclpy', 'matplotlib', 'yaml'):
    sys.modules[name] = None
import numpy as np
import cmpsp_ros.mpsp
from cmpsp_ros.mpsp import Subproblem, available, check_derivatives, from_functions
from cmpsp_ros.mpsp import solve_closed_form, solve_qp
assert available() == ('riccati_active_set', 'hildreth')
problem = from_functions(
    horizon=3, x0=[1.0], controls=1, F=lambda k, x, u: x + u, L=lambda k, x, u: u @ u,
    h=lambda x, u: x, target=[0.0],
)
U = np.zeros((4, 1))
assert check_derivatives(problem, U).is_right
lin = problem.linearise(problem.predict(U), U)
subproblem = Subproblem(lin, problem.control_lower, problem.control_upper, np.array([np.inf]))
found = [solve_closed_form(subproblem), *(solve_qp(subproblem, name) for name in available())]
for each in found:
    np.testing.assert_allclose(each.dU[:, 0], [-1.0 / 3.0] * 3 + [0.0], atol=1e-7)
"""


def test_every_name_is_there():
    for name in method.__all__:
        found = getattr(method, name)
        assert not isinstance(found, type) or found.__name__ == name


def test_other_names_are_not():
    with pytest.raises(AttributeError, match="has no attribute 'newton'"):
        _ = method.newton


def test_numpy_numba_and_scipy_are_enough():
    subprocess.run([sys.executable, '-c', ALONE], check=True)
