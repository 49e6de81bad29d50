"""Fig. 5 and the conditions of Theorem 2."""

import numpy as np
import pytest

from cmpsp_ros.studies.paper import table1
from cmpsp_ros.studies.paper.drives import guessed_path, run_law
from cmpsp_ros.studies.paper.experiments import FIG5_GUESSES, cases
from cmpsp_ros.studies.paper.iterations import Convergence, converge, measure_conditions

GUESSES = [guess for guess, _ in FIG5_GUESSES]


@pytest.mark.parametrize('guess', GUESSES)
def test_without_road_weight_convergence_is_linear_at_least(guess):
    run = converge(cases()[0], guess, 100, road_center=0.0)
    assert run.converged
    assert run.last_miss < 1e-9
    assert len(run.ratios) >= 2
    assert run.ratios.max() < 1.0
    assert run.ratios[-1] < 0.1


def test_full_steps_converge_from_near_and_not_from_afar():
    near = converge(cases()[0], (45.0, 44.5), 60, road_center=0.0, full_steps=True)
    far = converge(cases()[0], (30.0, 29.5), 60, road_center=0.0, full_steps=True)
    assert near.converged
    assert not far.converged


def test_with_road_weight_the_rate_creeps_towards_one():
    changes = converge(cases()[0], (45.0, 44.5), 200, road_center=15.0).changes
    ratios = changes[1:] / changes[:-1]
    assert 0.97 < ratios[50] < ratios[100] < ratios[-1] < 1.0


def test_errors_stop_at_rounding():
    controls = np.array([[1.0], [0.1], [0.01], [1e-12], [0.0]])
    run = Convergence(1.0, 0.0, controls)
    np.testing.assert_allclose(run.errors, [1.0, 0.1, 0.01])
    np.testing.assert_allclose(run.ratios, [0.1, 0.1])


@pytest.mark.parametrize('index', [0, 2])
def test_conditions(index):
    path = run_law(cases()[index], between_samples=False).path
    found = measure_conditions(path)
    assert found.size == 102
    assert found.rank_S_N == 2
    assert found.rank_G == found.columns_G
    assert 0.0 < found.least_eigenvalue < 1.0
    assert 0.0 < found.neglected < 1.0
    # Nothing is active without obstacles and limits; with them something is.
    assert (found.path_rows + found.wheel_rows > 0) == (index == 2)


def test_the_cost_is_not_convex_everywhere():
    assert measure_conditions(guessed_path(table1()[1])).least_eigenvalue < -1.0
