"""Merit, predicted reduction and relaxation levels in compiled code, against their definitions."""

import numpy as np
import pytest
from reference_merit import Merit
from stage_programs import random_program, relaxed, run, staged

from cmpsp_ros.mpsp import Dimensions, Evaluation
from cmpsp_ros.mpsp.qp import Subproblem
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.mpsp.sqp.iteration import LEVELS, relax
from cmpsp_ros.mpsp.sqp.line_search import (
    magnitude,
    merit,
    predicted_reduction,
    update_penalties,
    violation,
)
from cmpsp_ros.mpsp.sqp.workspace import workspace

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')

TERMINAL, PATH = np.array([3.0, 0.5]), np.array([0.5, 40.0])


def solved(seed=0):
    """A relaxed subproblem with its weights, and the merit of Python for it."""
    qp = random_program(np.random.default_rng(seed), bound=0.7)
    qp.g[:] += 0.5
    found = run(qp, relaxed(qp, 4.0, 4.0))
    assert found.outcome == Outcome.SOLVED
    p = found.space.program
    p.terminal['weight'], p.path['weight'] = TERMINAL, PATH
    update_penalties(p)
    raised = Merit(TERMINAL, np.tile(PATH, (6, 1))).above_multipliers(found.multipliers)
    return qp, found, p, raised


def trajectory(seed=1):
    """Memory with room for more stages than the program has, and random constraints in it."""
    rng = np.random.default_rng(seed)
    at = workspace(Dimensions(9, 3, 2, 2, 2), TERMINAL, PATH, np.full(3, np.inf)).now
    at.output_error[:], at.g[:] = rng.normal(size=2), rng.normal(size=at.g.shape)
    at.g[0] = -np.inf
    return at


def test_weights_are_raised_above_the_multipliers():
    _, _, p, raised = solved()
    np.testing.assert_allclose(p.terminal['merit'], raised.terminal)
    np.testing.assert_allclose(p.path['merit'], raised.path)
    assert (p.path['merit'] > PATH).any()
    assert (p.path['merit'] == PATH).any()


def test_merit_of_a_trajectory():
    _, _, p, raised = solved()
    at = trajectory()
    evaluation = Evaluation(7.0, at.output_error, at.g[:6])
    assert violation(p, at) == pytest.approx(raised.violation(evaluation))
    assert merit(p, at, 7.0) == pytest.approx(raised.value(evaluation))
    assert magnitude(p, 7.0) == pytest.approx(raised.magnitude(evaluation))
    assert merit(p, at, np.nan) == merit(p, at, -np.inf) == np.inf
    for part in (at.output_error, at.g[3]):
        before, part[1] = part[1], np.nan
        assert merit(p, at, 7.0) == np.inf
        part[1] = before
    # Beyond the horizon nothing counts.
    at.g[6:] = np.nan
    assert merit(p, at, 7.0) == pytest.approx(raised.value(evaluation))


def test_predicted_reduction_and_slack():
    qp, found, p, raised = solved()
    program: Subproblem = staged(qp)
    slack = np.full(4, np.nan)
    wanted = raised.predicted_decrease(program, found.dU)
    assert predicted_reduction(p, slack) == pytest.approx(wanted)
    assert wanted > 0.0
    np.testing.assert_allclose(
        slack[:2], np.maximum(program.path(found.dU, found.dX), 0.0).max(axis=0), atol=1e-12
    )
    np.testing.assert_allclose(slack[2:], np.abs(program.terminal(found.dU, found.dX)), atol=1e-12)
    # Rows that do not apply have no part in it.
    p.path['value'][2] = -np.inf
    assert np.isfinite(predicted_reduction(p, slack))


@pytest.mark.parametrize(
    ('weights', 'soft'),
    [
        ([1.0, 2.0, 3.0, 4.0], [[], [0], [0, 1], [0, 1, 2, 3]]),
        ([5.0, 2.0, 2.0, 5.0], [[], [1, 2], [0, 1, 2, 3], [0, 1, 2, 3]]),
        ([7.0, 7.0, 7.0, 7.0], [[], [0, 1, 2, 3], [0, 1, 2, 3], [0, 1, 2, 3]]),
        ([np.inf, 1.0, np.inf, 2.0], [[], [1], [1, 3], [1, 3]]),
    ],
    ids=str,
)
def test_the_lightest_constraints_are_relaxed_first(weights, soft):
    """Two outputs and two path constraints; what is relaxed has its weight for a penalty."""
    weights = np.array(weights)
    p = workspace(Dimensions(5, 3, 2, 2, 2), weights[:2], weights[2:], np.full(3, np.inf)).program
    for level in range(LEVELS + 1):
        is_hard = relax(p, level)
        wanted = np.where(np.isin(range(4), soft[level]), weights, np.inf)
        np.testing.assert_array_equal(p.terminal['penalty'], wanted[:2])
        np.testing.assert_array_equal(p.path['penalty'], np.tile(wanted[2:], (6, 1)))
        # At the last level all is relaxed that may be.
        assert is_hard == (len(soft[level]) < 4 and level < LEVELS)
