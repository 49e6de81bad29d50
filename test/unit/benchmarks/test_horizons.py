"""Growth over horizons."""

import pytest

from benchmarks.families.horizons import Growth, grow
from benchmarks.methods.condensed_method import CondensedDaqp


class Short(CondensedDaqp):
    name, largest = 'short', 4


class Lazy(CondensedDaqp):
    name = 'lazy'

    def step(self, pose, U, durations):
        return U


def test_the_exponent_is_fitted_to_long_horizons_only():
    times = {10: 1.0, 50: 1.0, **{steps: 3e-6 * steps**2.5 for steps in (100, 200, 400)}}
    growth = Growth.of('method', times)
    assert growth.exponent == pytest.approx(2.5)
    assert growth.steps == list(times)
    assert Growth.of('method', {50: 1.0, 100: 2.0}).exponent is None


def test_each_horizon_is_timed_for_those_who_can(task):
    told = []
    methods = [CondensedDaqp(task), Short(task), Lazy(task)]
    all_steps, short, lazy = grow(task, methods, (4, 8), 2, lambda: told.append(1))
    assert all_steps.steps == [4, 8]
    assert short.steps == [4]
    assert lazy.steps == []
    assert min(all_steps.times) > 0.0
    assert len(told) == 2
