"""One plan over long horizons, and other solvers beside it."""

from dataclasses import replace

import pytest

from benchmarks.errors import BenchError
from benchmarks.families import long_horizons
from benchmarks.families.long_horizons import LongHorizons, LongStep, long_task, measure


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
    found = measure((50, 100), 1, beside=False, progress=lambda: told.append(1))
    assert [each.steps for each in found.found] == [50, 100]
    for each in found.found:
        assert 0.4 < each.active < 0.6
        assert each.times.keys() == {'warm', 'cold'}
        assert min(each.times.values()) > 0.0
        assert each.work > 0
        assert each.ratios == {}
    assert found.missing == {}
    assert len(told) == 2


def test_peers_take_the_same_steps():
    pytest.importorskip('casadi')
    (found,) = measure((25,), 1, beside=True).found
    assert found.ratios
    for name, (ratio, ratio_of_qps) in found.ratios.items():
        assert name in long_horizons.QP_PEERS
        assert found.times[name] > found.times['warm'] > 0.0
        assert 0.0 < ratio <= ratio_of_qps


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
    monkeypatch.setattr(long_horizons, 'peers', lambda task: ([Failing(), Lazy()], missing))
    found = measure((25,), 1, beside=True)
    assert found.found[0].ratios == {}
    assert found.missing.keys() == {
        'casadi', 'sqpmethod + piqp, N = 25', 'sqpmethod + hpipm, N = 25',
    }  # fmt: skip
    assert found.missing['sqpmethod + piqp, N = 25'] == 'out of order'
    assert 'misses the goal' in found.missing['sqpmethod + hpipm, N = 25']


def test_without_a_plan_there_is_no_time(monkeypatch):
    monkeypatch.setattr(long_horizons, 'LIMIT', 30.0)
    with pytest.raises(BenchError, match='found no plan'):
        measure((25,), 1, beside=False)


def test_the_drive_is_the_same_at_every_number_of_steps():
    short, long = long_task(50), long_task(400)
    assert (short.steps, long.steps) == (50, 400)
    same = replace(short.settings, control_period=long.settings.control_period)
    assert same == long.settings
