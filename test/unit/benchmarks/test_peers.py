"""Other people's solvers: the same problem, or it would be no comparison."""

import numpy as np
import pytest

from benchmarks.horizons import Growth
from benchmarks.loops import close_loop
from cmpsp_ros.mpsp import Options
from cmpsp_ros.mpsp.sqp import CMPSP

pytest.importorskip('casadi')

from benchmarks.methods.casadi_methods import Converged, Sqp, pack, program, unpack

STEPS = 8


def test_the_program_has_the_value_of_the_problem(task):
    import casadi

    U = task.guess(STEPS) + np.linspace(-1.0, 1.0, 2 * STEPS + 2).reshape(-1, 2)
    durations = task.durations(STEPS)
    made = program(task, STEPS)
    w, p = pack(task, task.pose, U, durations)
    cost, proximal, g = (
        np.asarray(each).ravel()
        for each in casadi.Function('f', [made.w, made.p], [made.cost, made.proximal, made.g])(w, p)
    )
    problem = task.problem(task.pose, durations)
    evaluation = problem.evaluate(problem.predict(U), U)
    assert cost.item() == pytest.approx(evaluation.cost)
    assert proximal.item() == 0.0
    equality = np.array(made.equality)
    gaps = g[equality] - made.limits['lbg'][equality]
    np.testing.assert_allclose(gaps[:-2], 0.0, atol=1e-12)
    np.testing.assert_allclose(gaps[-2:], evaluation.output_error, atol=1e-12)
    room = np.minimum(g - made.limits['lbg'], made.limits['ubg'] - g)[~equality]
    assert -room.min() == pytest.approx(evaluation.g.max())
    np.testing.assert_array_equal(unpack(w, U[-1]), U)


@pytest.mark.parametrize('plugin', ['hpipm', 'piqp'])
@pytest.mark.parametrize('steps', [STEPS, 20])
def test_one_iteration_is_that_of_the_method(task, plugin, steps):
    """Constraints, kinematics, gradient and Hessian all agree, or the iterates would not."""
    import casadi

    if not casadi.has_conic(plugin):
        pytest.skip(f'{plugin} is not part of this CasADi')
    peer = Sqp(task, plugin, {}, largest=steps, iterations=1)
    peer.prepare(steps)
    U, durations = task.guess(steps), task.durations(steps)
    iteration = CMPSP(
        task.problem(task.pose, durations),
        Options(np.full(2, 1e4), np.full(4, 1e4), line_search=False),
    )
    wanted = iteration.step(iteration.init(U)).U
    np.testing.assert_allclose(peer.step(task.pose, U, durations)[:-1], wanted[:-1], atol=1e-5)


def test_solvers_that_converge_agree(task):
    ends = []
    for solver, keeps in (('ipopt', True), ('fatrop', False)):
        peer = Converged(task, solver, {'print_level': 0}, keeps_multipliers=keeps)
        for steps in range(STEPS, 0, -1):
            peer.prepare(steps)
        ends.append(close_loop(task, peer, STEPS).wheel_speeds)
    np.testing.assert_allclose(*ends, atol=1e-3)


def test_the_exponent_is_fitted_to_long_horizons_only():
    times = {10: 1.0, 50: 1.0, **{steps: 3e-6 * steps**2.5 for steps in (100, 200, 400)}}
    growth = Growth.of('method', times)
    assert growth.exponent == pytest.approx(2.5)
    assert growth.steps == list(times)
    assert Growth.of('method', {50: 1.0, 100: 2.0}).exponent is None
