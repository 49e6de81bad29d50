"""Instants of odometry: an exact grid, or each late by its own random time."""

import numpy as np
import pytest

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import OdometrySchedule, PlantSettings

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
