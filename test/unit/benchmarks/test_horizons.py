"""Growth over horizons, and one plan over long ones beside other solvers."""

import pytest

from benchmarks import horizons
from benchmarks.common import BenchError
from benchmarks.horizons import Growth, LongHorizons, LongStep, time_long_horizons


def test_the_exponent_is_fitted_to_long_horizons_only():
    times = {10: 1.0, 50: 1.0, **{steps: 3e-6 * steps**2.5 for steps in (100, 200, 400)}}
    growth = Growth.of('method', times)
    assert growth.exponent == pytest.approx(2.5)
    assert growth.steps == list(times)
    assert Growth.of('method', {50: 1.0, 100: 2.0}).exponent is None


def of_times(times, peer=None):
    others = {} if peer is None else {'other': peer}
    return [
        LongStep(N, 0.5, 5.0, 10.0, {'warm': time, 'cold': 2.0 * time, **others}, {})
        for N, time in times.items()
    ]


def test_the_exponent_is_fitted_to_all_horizons():
    found = LongHorizons(of_times({N: 3e-3 * N**1.5 for N in (50, 100, 200)}, 7.0), {})
    assert found.exponent() == found.exponent('warm') == pytest.approx(1.5)
    assert found.exponent('cold') == pytest.approx(1.5)
    assert found.exponent('other') == pytest.approx(0.0, abs=1e-9)
    assert found.exponent('nobody') is None
    assert LongHorizons(of_times({50: 1.0}), {}).exponent() is None


def test_half_of_the_bounds_are_active_on_every_horizon():
    told = []
    found = time_long_horizons((50, 100), 1, beside=False, progress=lambda: told.append(1))
    assert [each.steps for each in found.found] == [50, 100]
    for each in found.found:
        assert 0.4 < each.active < 0.6
        assert each.times.keys() == {'warm', 'cold'}
        assert min(each.times.values()) > 0.0
        assert each.work > 0
        assert each.ratios == {}
    assert found.missing == {}
    assert len(told) == 2


def test_a_peer_that_fails_says_why(monkeypatch):
    class Failing:
        name, largest = 'sqpmethod + piqp', 400

        def prepare(self, steps):
            pass

        def step(self, pose, U, durations):
            raise BenchError('out of order')

    class Lazy(Failing):
        name = 'sqpmethod + hpipm'

        def step(self, pose, U, durations):
            return 0.0 * U

    missing = {'qrqp': 'not asked', 'casadi': 'not installed'}
    monkeypatch.setattr(horizons, 'peers', lambda task: ([Failing(), Lazy()], missing))
    found = time_long_horizons((25,), 1, beside=True)
    assert found.found[0].ratios == {}
    assert found.missing.keys() == {
        'casadi', 'sqpmethod + piqp, N = 25', 'sqpmethod + hpipm, N = 25',
    }  # fmt: skip
    assert found.missing['sqpmethod + piqp, N = 25'] == 'out of order'
    assert 'misses the goal' in found.missing['sqpmethod + hpipm, N = 25']
