"""Horizons from the clock, and plans moved from one to the next."""

import numpy as np
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.guidance import NANOSECONDS, remaining, shift, to_nanoseconds
from cmpsp_ros.guidance.horizon import retimed
from cmpsp_ros.robots import DifferentialDrive

unhurried = hypothesis_settings(deadline=None)
PERIOD = 200_000_000


@st.composite
def clocks(draw):
    period = draw(st.integers(2, 10**9))
    final = draw(st.integers(period, 40 * period))
    now = draw(st.integers(0, final - 1))
    return now, period, final


@unhurried
@given(clocks())
def test_horizon(clock):
    now, period, final = clock
    horizon = remaining(now, period, final)
    edges = horizon.edges
    half = period // 2
    assert edges.dtype == np.int64
    assert len(edges) >= 2
    assert edges[0] == now
    steps = np.diff(edges)
    assert (steps > 0).all()
    assert (steps[1:-1] == period).all()
    assert (steps >= half).all()
    # Only where the final time is no whole number of periods, and the last step is all there is,
    # can both of the instants next to it be too near.
    alone = len(steps) == 1 and final % period
    assert (steps <= period + (2 * half if alone else half) + 1).all()
    assert edges[-1] == max(final, now + half)
    assert not (edges[1:-1] % period).any()
    np.testing.assert_allclose(horizon.durations * NANOSECONDS, steps, rtol=1e-12)


def test_horizon_by_hand():
    final = 5 * PERIOD
    late = remaining(PERIOD + 7, PERIOD, final)
    np.testing.assert_array_equal(late.edges, [PERIOD + 7, *PERIOD * np.arange(2, 6)])
    very_late = remaining(PERIOD + PERIOD // 2 + 1, PERIOD, final)
    np.testing.assert_array_equal(very_late.edges[1:], PERIOD * np.arange(3, 6))
    last = remaining(final - 1, PERIOD, final)
    np.testing.assert_array_equal(last.edges, [final - 1, final - 1 + PERIOD // 2])
    odd = remaining(0, PERIOD, final + PERIOD // 2 - 1)
    np.testing.assert_array_equal(odd.edges, [*PERIOD * np.arange(5), final + PERIOD // 2 - 1])


def test_seconds_to_nanoseconds():
    assert to_nanoseconds(0.2) == PERIOD
    assert to_nanoseconds(0.1 + 0.2) == 300_000_000
    assert isinstance(to_nanoseconds(10.0), int)


@unhurried
@given(first=st.integers(0, 48), later=st.integers(0, 48), seed=st.integers(0, 9))
def test_aligned_shift_is_exact(first, later, seed):
    first, later = min(first, later), max(first, later)
    old, new = (remaining(k * PERIOD, PERIOD, 50 * PERIOD) for k in (first, later))
    controls = np.random.default_rng(seed).normal(size=(len(old.edges), 2))
    np.testing.assert_array_equal(shift(controls, old, new), controls[later - first :])


@unhurried
@given(clocks(), st.data())
def test_shift_holds_what_was_planned(clock, data):
    now, period, final = clock
    old = remaining(now, period, final)
    later = data.draw(st.integers(now, final - 1))
    new = remaining(later, period, final)
    controls = np.arange(2.0 * len(old.edges)).reshape(-1, 2)
    shifted = shift(controls, old, new)
    assert shifted.shape == (len(new.edges), 2)
    np.testing.assert_array_equal(shifted[-1], controls[-1])
    for k in range(len(new.edges) - 1):
        middle = (int(new.edges[k]) + int(new.edges[k + 1])) // 2
        held = sum(int(edge) <= middle for edge in old.edges) - 1
        held = min(held, len(old.edges) - 2)
        np.testing.assert_array_equal(shifted[k], controls[held])


def test_shift_beyond_the_end_continues_the_last_step():
    old = remaining(4 * PERIOD, PERIOD, 5 * PERIOD)
    new = remaining(5 * PERIOD - 1, PERIOD, 5 * PERIOD)
    controls = np.array([[1.0, 2.0], [3.0, 4.0]])
    np.testing.assert_array_equal(shift(controls, old, new), controls)


@unhurried
@given(st.integers(30, 90), st.integers(0, 20), st.integers(0, 2**32 - 1))
def test_driven_faster_or_slower_the_wheels_turn_as_far(periods, later, seed):
    old = remaining(0, PERIOD, 50 * PERIOD)
    new = remaining(later * PERIOD, PERIOD, (later + periods) * PERIOD)
    controls = np.random.default_rng(seed).normal(size=(len(old.edges), 2))

    found = retimed(controls, old, new, DifferentialDrive())

    def turned(speeds, horizon):
        return np.cumsum(speeds[:-1] * horizon.durations[:, None], axis=0)

    left, whole = turned(controls[later:], shift_of(old, later)), turned(found, new)
    np.testing.assert_allclose(whole[-1], left[-1], atol=1e-9)
    # Also at the instants between, wherever an old edge falls on a new one.
    part = np.arange(1, len(whole)) * len(left) % len(whole) == 0
    at = np.arange(1, len(whole))[part] * len(left) // len(whole)
    np.testing.assert_allclose(whole[:-1][part], left[at - 1], atol=1e-9)
    np.testing.assert_allclose(found[-1], controls[-1] * len(left) / len(whole))


def shift_of(horizon, stages):
    return remaining(stages * PERIOD, PERIOD, int(horizon.edges[-1]))
