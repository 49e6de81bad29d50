"""Estimated rates of sequences whose rate is known, and of those that have none."""

from types import SimpleNamespace

import numpy as np
import pytest
from problems import VanDerPol

from cmpsp_ros.mpsp import Options
from cmpsp_ros.mpsp.convergence import Convergence
from cmpsp_ros.mpsp.sqp.solve import solve

TARGET = np.array([[1.0, -2.0], [0.5, 3.0]])
DIRECTION = np.array([[0.6, 0.0], [0.0, -0.8]])


def sequence(errors, target=TARGET):
    return [SimpleNamespace(U=target + error * DIRECTION) for error in errors]


def geometric(rate, count, first=1.0):
    return first * rate ** np.arange(count)


@pytest.mark.parametrize('rate', [0.1, 0.5, 0.9, 0.994])
@pytest.mark.parametrize('known', [True, False])
def test_rate_of_a_geometric_sequence(rate, known):
    count = {0.1: 9, 0.5: 30, 0.9: 120, 0.994: 1500}[rate]
    found = Convergence.of(sequence(geometric(rate, count, 3.0)), TARGET if known else None)
    assert found.rate == pytest.approx(rate, rel=1e-3 if known else 0.03)
    assert found.interval[0] <= found.rate <= found.interval[1] < 1.0
    assert found.gamma == pytest.approx(3.0, rel=1e-2 if known else 0.9)
    assert f'Q-linear at {found.rate:.3g}' in found.sentence


@pytest.mark.parametrize('seed', range(40))
def test_the_interval_covers_the_rate(seed):
    rng = np.random.default_rng(seed)
    errors = geometric(0.6, 30) * np.exp(0.2 * rng.normal(size=30))
    found = Convergence.of(sequence(errors), TARGET)
    # 95 % of them; the seeds that miss are few and narrow misses.
    width = found.interval[1] - found.interval[0]
    assert found.interval[0] - width < 0.6 < found.interval[1] + width
    assert 0.0 < width < 0.1


def test_bound_90_holds_on_the_tail():
    rng = np.random.default_rng(1)
    errors = geometric(0.7, 25) * np.exp(0.3 * rng.normal(size=25))
    found = Convergence.of(sequence(errors), TARGET)
    tail = np.array(found.used)
    assert (errors[tail] <= found.gamma * found.rate**tail * (1.0 + 1e-9)).all()
    for wanted in (1e-1, 1e-3, 1e-8):
        iterations = found.iterations_for(wanted)
        assert found.gamma * found.rate**iterations <= wanted
        assert iterations == 0 or found.gamma * found.rate ** (iterations - 1) > wanted
    assert found.iterations_for(1e3) == 0


def test_the_way_there_does_not_count():
    errors = np.concatenate([np.linspace(10.0, 9.0, 12), geometric(0.5, 30, 8.0)])
    found = Convergence.of(sequence(errors), TARGET)
    assert found.rate == pytest.approx(0.5, rel=1e-6)
    assert found.used[0] >= 12


def test_rounding_does_not_count():
    errors = np.concatenate([geometric(0.1, 12), np.full(30, 3e-13)])
    found = Convergence.of(sequence(errors))
    assert found.rate == pytest.approx(0.1, rel=1e-2)
    assert found.used[-1] < 12


@pytest.mark.parametrize(
    ('errors', 'target', 'reason'),
    [
        ([1.0, 0.5, 0.25], None, '3 iterates are too few'),
        ([1.0, 1e-13, 1e-13, 1e-13, 1e-13], TARGET, '1 errors stand clear'),
        (geometric(1.1, 30), None, 'the steps do not become shorter'),
        (geometric(1.1, 30), TARGET, 'is not known to be below 1'),
        ([1.0, 0.5, 1.0, 0.5, 1.0, 0.5, 1.0], TARGET, 'is not known to be below 1'),
        ([1.0, 0.1, 0.1, 0.1, 0.1], None, 'errors stand clear'),
        ([1.0, 0.1, 0.1, 0.1, 0.01], None, 'the steps do not become shorter'),
    ],
)
def test_cannot_tell(errors, target, reason):
    found = Convergence.of(sequence(errors), target)
    assert found.rate is None
    assert found.interval is None
    assert found.gamma is None
    assert found.used == ()
    assert found.iterations_for(1e-3) is None
    assert found.sentence.startswith('The rate cannot be determined: ')
    assert reason in found.sentence


def test_rate_of_a_run_against_its_own_optimum():
    problem = VanDerPol(goal=(0.4, -0.2), floor=-0.5)
    options = Options(np.full(2, 1e3), np.full(2, 1e3), control_tolerance=1e-10)
    run = solve(problem, np.zeros((21, 1)), options, 60)
    alone = Convergence.of(run.history)
    known = Convergence.of(run.history[:-3], run.iterate.U)
    assert 0.0 < alone.rate < 0.9
    assert alone.interval[0] < known.rate < alone.interval[1] or (
        known.rate == pytest.approx(alone.rate, rel=0.05)
    )
