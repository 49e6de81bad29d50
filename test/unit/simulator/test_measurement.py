"""Odometry that differs from the truth, each error by itself."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.simulator import OdometryErrors
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
