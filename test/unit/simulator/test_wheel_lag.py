"""Wheels behind their command: the angle turned is exact, the path nearly."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.simulator.body import SLICE_NS, LaggedWheels

SLICE = SLICE_NS / 1e9

speeds = st.tuples(*[st.floats(-60.0, 60.0)] * 2).map(np.array)
time_constants = st.sampled_from([1e-9, 1e-3, 0.02, 0.1, 1.0])


@given(speeds, speeds, time_constants, st.integers(1, 300))
def test_the_angle_turned_is_that_of_the_differential_equation(before, target, constant, count):
    wheels = LaggedWheels(before, target, constant)
    turned = wheels.means(0, count).sum(axis=0) * SLICE
    end = count * SLICE
    exact = target * end + (before - target) * constant * -math.expm1(-end / constant)
    # What is left when a wheel counts as having reached its command is never turned.
    assert np.allclose(turned, exact, rtol=1e-12, atol=1e-8 * constant + 1e-12)
    assert np.allclose(wheels.at(end), target + (before - target) * math.exp(-end / constant))


@given(speeds, speeds, time_constants)
def test_the_command_is_reached_and_never_passed(before, target, constant):
    wheels = LaggedWheels(before, target, constant)
    last = wheels.slices
    assert (wheels.means(last, last + 1)[0] == target).all()
    gaps = np.abs(wheels.means(0, min(last, 2000) + 1) - target)
    assert (np.diff(gaps, axis=0) <= 1e-12).all()
    assert (gaps <= np.abs(before - target) + 1e-12).all()


@given(speeds, speeds, time_constants, st.integers(0, 50), st.integers(1, 50))
def test_slices_are_the_same_bits_however_many_are_asked_for(before, target, constant, first, more):
    wheels = LaggedWheels(before, target, constant)
    together = wheels.means(first, first + more)
    single = [wheels.means(k, k + 1)[0] for k in range(first, first + more)]
    assert (together == np.array(single)).all()


@pytest.mark.parametrize('constant', [0.0, 1e-320])
def test_without_lag_the_command_is_obeyed_at_once(constant):
    wheels = LaggedWheels(np.zeros(2), np.array([51.0, 40.0]), constant)
    assert wheels.slices == 0
    assert (wheels.at(0.0) == [51.0, 40.0]).all()
    assert (wheels.means(0, 2) == [51.0, 40.0]).all()
