"""Two models of how people walk: little doubt on a straight walk, enough at a turn."""

import math

import numpy as np
import pytest

from cmpsp_ros.sensing.motion_filter import InteractingFilters, MotionFilter, MotionState

PERIOD = 100_000_000
NOISE = 0.02


def follow(kind, velocity, seconds=6.0, seed=0):
    """States after each scan, with true place and velocity; `velocity` is of the time [s]."""
    random = np.random.default_rng(seed)
    place, known, seen = np.zeros(2), None, []
    for k in range(round(10 * seconds)):
        place = place + 0.1 * np.array(velocity(0.1 * k))
        measured = *(place + NOISE * random.standard_normal(2)).tolist(), NOISE**2
        if known is None:
            known = kind(0, *measured)
        known.predict(k * PERIOD)
        known.correct(*measured)
        true = np.array(velocity(0.1 * k))
        off = math.hypot(*(np.array([known.vx, known.vy]) - true))
        seen.append((off, known.stddevs[1], getattr(known, 'turning', 0.0)))
    return np.array(seen)


def straight(_time):
    return 1.0, 0.0


def turns(time):
    """A quarter of a turn within a second, 1.6 m/s^2, after three seconds."""
    angle = math.pi / 2.0 * min(max(time - 3.0, 0.0), 1.0)
    return math.cos(angle), math.sin(angle)


def test_who_walks_straight_is_known_better_than_by_one_model():
    two, one = follow(InteractingFilters, straight), follow(MotionFilter, straight)
    assert two[20:, 1].mean() < 0.75 * one[20:, 1].mean()
    assert (two[20:, 2] < 0.1).all()


def test_velocities_are_as_wrong_as_is_said():
    runs = [follow(InteractingFilters, turns, seed=seed)[5:] for seed in range(40)]
    off, stddev, turning = np.concatenate(runs).T
    assert (off > 3.0 * stddev).mean() < 0.01
    assert min(run[25:36, 2].max() for run in runs) > 0.3
    assert turning.mean() < 0.3


def test_state_is_the_mean_and_its_covariance():
    one = MotionFilter(0, 1.0, 2.0, 0.04, 0.5, -0.5, 0.01, 0.09)
    other = MotionFilter(0, 1.4, 1.0, 0.02, 0.1, 0.3, 0.02, 0.16)
    found = MotionState(0, 0.0, 0.0, 0.0)
    found.mix(one, other, 0.3)
    random = np.random.default_rng(1)
    samples = []
    for state, count in ((one, 140_000), (other, 60_000)):
        matrix = [
            [state.position_variance, state.covariance],
            [state.covariance, state.velocity_variance],
        ]
        means = (state.x, state.vx), (state.y, state.vy)
        samples += [random.multivariate_normal(mean, matrix, count) for mean in means]
    axes = [np.concatenate([samples[axis], samples[axis + 2]]) for axis in (0, 1)]
    np.testing.assert_allclose((found.x, found.vx), axes[0].mean(axis=0), atol=5e-3)
    np.testing.assert_allclose((found.y, found.vy), axes[1].mean(axis=0), atol=5e-3)
    covariance = (np.cov(axes[0].T) + np.cov(axes[1].T)) / 2.0
    np.testing.assert_allclose(found.position_variance, covariance[0, 0], rtol=0.02)
    np.testing.assert_allclose(found.covariance, covariance[0, 1], atol=2e-3)
    np.testing.assert_allclose(found.velocity_variance, covariance[1, 1], rtol=0.02)


@pytest.mark.parametrize('off', [0.0, 5.0, 500.0])
def test_two_sensors_at_one_time_and_a_place_that_cannot_be(off):
    known = InteractingFilters(0, 0.0, 0.0, 0.01)
    for k in range(20):
        known.predict(k * PERIOD)
        known.correct(0.1 * k, 0.0, 0.01)
        known.predict(k * PERIOD)
        known.correct(0.1 * k + off, 0.0, 0.01)
    assert 0.0 <= known.turning <= 1.0
    assert all(math.isfinite(each) for each in (known.x, known.vx, *known.stddevs))


def test_doubt_about_who_is_out_of_sight_grows_as_with_one_model():
    one, two = MotionFilter(0, 0.0, 0.0, 1e-4), InteractingFilters(0, 0.0, 0.0, 1e-4)
    for known in (one, two):
        for k in range(30):
            known.predict(k * PERIOD)
            known.correct(0.1 * k, 0.0, 4e-4)
        for k in range(30, 60):
            known.predict(k * PERIOD)
    assert two.stddevs[0] == pytest.approx(one.stddevs[0], rel=0.15)
