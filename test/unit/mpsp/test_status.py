"""Names of what is violated, and sentences a user can read."""

import numpy as np
from problems import VanDerPol

from cmpsp_ros.mpsp import Evaluation, Options
from cmpsp_ros.mpsp.results import Status, Violation, violations
from cmpsp_ros.mpsp.sqp.cmpsp import solve

NOTHING = Evaluation(0.0, np.empty(0), np.empty((3, 0)))


def test_the_worst_comes_first():
    g = np.array([[-np.inf, 0.5], [-1.0, 2.0], [0.01, 0.0]])
    found = violations(Evaluation(0.0, np.array([-1.0, 0.05]), g), 0.1, 0.02)
    assert found == (
        Violation(1, 1, False, 2.0),
        Violation(2, 0, True, -1.0),
        Violation(0, 1, False, 0.5),
    )


def test_what_is_not_a_number_is_violated():
    g = np.array([[0.0], [np.nan]])
    (found,) = violations(Evaluation(0.0, np.zeros(1), g), 1e-6, 1e-6)
    assert (found.stage, found.index) == (1, 0)


def test_a_long_list_is_cut():
    problem = VanDerPol(floor=0.6, passes=False, limit=0.1)
    solution = solve(problem, np.zeros((21, 1)), Options(np.zeros(0), np.full(2, 1e3)), 0)
    assert solution.status is Status.ITERATION_LIMIT
    assert len(solution.violated) == 20
    assert solution.sentence.count('is exceeded by') == 4
    assert solution.sentence.endswith('; and 16 more.')
    assert 'Iterations: 0;' in solution.sentence


def test_a_short_list_is_not():
    problem = VanDerPol(goal=(0.4, -0.2))
    solution = solve(problem, np.zeros((21, 1)), Options(np.full(2, 1e3), np.ones(2)), 0)
    assert 'Not met: terminal output' in solution.sentence
    assert 'more' not in solution.sentence
