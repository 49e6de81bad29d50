"""Odometry that differs from the truth, each error by itself, and when it is measured."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import OdometryErrors, OdometrySchedule, PlantSettings
from cmpsp_ros.simulator.measurement import Measurement, Stream, generator

POSE = np.array([1.0, -2.0, 3.0])
COUNT = 200

errors = st.builds(
    OdometryErrors,
    position_stddev=st.sampled_from([0.0, 0.02]),
    heading_stddev=st.sampled_from([0.0, 0.1]),
    bias=st.sampled_from([(0.0, 0.0, 0.0), (0.1, -0.2, 0.3)]),
    drift=st.sampled_from([(0.0, 0.0, 0.0), (0.01, 0.02, -0.03)]),
    dropout=st.sampled_from([0.0, 0.3, 1.0]),
    dropout_windows=st.sampled_from([(), ((0.5, 1.0),), ((0.0, 0.2), (3.0, 4.0))]),
)


def messages(of, seed=7):
    """Messages 20 ms apart."""
    measurement = Measurement(seed)
    return [measurement.measure(of, 0.02 * k, POSE) for k in range(COUNT)]


@given(errors)
def test_the_same_seed_gives_the_same_bits(of):
    for one, other in zip(messages(of), messages(of), strict=True):
        assert (one is None and other is None) or (one == other).all()


@given(errors)
def test_what_is_lost_does_not_change_the_others(of):
    complete = messages(replace(of, dropout=0.0, dropout_windows=()))
    for with_loss, without in zip(messages(of), complete, strict=True):
        assert with_loss is None or (with_loss == without).all()


@given(errors)
def test_each_noise_has_numbers_of_its_own(of):
    of = replace(of, dropout=0.0, dropout_windows=())
    both = np.array(messages(replace(of, position_stddev=0.02, heading_stddev=0.1)))
    position = np.array(messages(replace(of, position_stddev=0.02, heading_stddev=0.0)))
    heading = np.array(messages(replace(of, position_stddev=0.0, heading_stddev=0.1)))
    assert (both[:, :2] == position[:, :2]).all()
    assert (both[:, 2] == heading[:, 2]).all()


def test_without_errors_the_pose_is_handed_on_as_a_copy():
    [first, *_] = messages(OdometryErrors())
    assert (first == POSE).all()
    first[:] = 0.0
    assert (POSE == [1.0, -2.0, 3.0]).all()


def test_bias_stays_and_drift_grows():
    measured = np.array(messages(OdometryErrors(bias=(0.1, 0.2, 0.3), drift=(0.0, 0.5, -1.0))))
    assert np.allclose(measured[0] - POSE, [0.1, 0.2, 0.3])
    assert np.allclose(measured[100] - POSE, [0.1, 0.2 + 0.5 * 2.0, 0.3 - 2.0])


def test_messages_are_lost_in_windows_and_at_random():
    lost = [each is None for each in messages(OdometryErrors(dropout_windows=((0.5, 1.0),)))]
    assert [k for k, is_lost in enumerate(lost) if is_lost] == list(range(25, 50))
    share = np.mean([each is None for each in messages(OdometryErrors(dropout=0.3))])
    assert share == pytest.approx(0.3, abs=0.1)


def test_streams_are_those_that_numpy_spawns():
    children = np.random.SeedSequence(5).spawn(len(Stream))
    for stream, child in zip(Stream, children, strict=True):
        expected = np.random.default_rng(child).random(4)
        assert (generator(5, stream).random(4) == expected).all()
    assert len({generator(5, stream).random() for stream in Stream}) == len(Stream)


MS = 1_000_000


def instants(count=300, start_ns=0, **settings):
    schedule = OdometrySchedule(PlantSettings(DifferentialDrive(), **settings), start_ns)
    found = []
    for _ in range(count):
        found.append(schedule.next_ns)
        schedule.advance()
    return np.array(found)


@pytest.mark.parametrize(('rate', 'period'), [(50.0, 20 * MS), (30.0, 33_333_333)])
def test_without_jitter_they_are_a_grid_from_the_start_on(rate, period):
    assert (instants(start_ns=7, odom_rate=rate) == 7 + period * np.arange(300)).all()


def test_with_jitter_each_is_late_by_its_own_time_and_seeds_repeat():
    late = instants(odom_jitter=0.01, seed=3) - 20 * MS * np.arange(300)
    assert late.min() >= 0
    assert late.max() <= 10 * MS
    assert late.mean() == pytest.approx(5 * MS, rel=0.1)
    assert len(set(late.tolist())) == 300
    assert (late == instants(odom_jitter=0.01, seed=3) - 20 * MS * np.arange(300)).all()
    assert (late != instants(odom_jitter=0.01, seed=4) - 20 * MS * np.arange(300)).any()


def test_a_jitter_below_the_period_keeps_the_order():
    assert (np.diff(instants(odom_jitter=0.0199, seed=1)) > 0).all()
