"""Robots on long horizons."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.errors import BenchError
from benchmarks.families import robot_drives
from benchmarks.families.robot_drives import (
    RobotDrive,
    measure,
    of_models,
    of_robots,
    robots_that_fit,
)
from cmpsp_ros.guidance.planning import Planner
from cmpsp_ros.parameters import ParameterError


def test_a_robot_drives_to_the_goal():
    told, improve = [], Planner.improve
    (found,) = measure(of_robots(['jackal']), 2, lambda: told.append(1))
    assert found.name == 'jackal'
    assert found.times.shape == (2, 50)
    assert found.times.min() > 0.0
    assert found.work.shape == (50,)
    assert found.work.min() > 0
    assert sum(found.levels.values()) == 50
    assert found.terminal_error < 0.01
    assert len(told) == 2
    assert Planner.improve is improve


def test_a_car_beside_a_differential_drive():
    for found in measure(of_models(), 1):
        assert found.times.shape == (1, 50)
        assert found.levels == {'nominal': 50}
        assert found.terminal_error < 1e-3


def test_no_such_robot():
    with pytest.raises(ParameterError, match='jackall'):
        of_robots(['jackall'])


def test_runs_that_differ(monkeypatch):
    drive = RobotDrive('odd', np.ones((1, 2)), np.ones(2, int), {'nominal': 2}, 0.0)
    drives = iter([drive, replace(drive, work=np.array([1, 2]))])
    monkeypatch.setattr(robot_drives, '_drive', lambda name, scenario: next(drives))
    with pytest.raises(BenchError, match='runs that differ'):
        measure(of_robots(['jackal']), 2)


def test_robots_that_are_too_wide_for_the_road_are_left_out():
    fit = robots_that_fit()
    assert 'turtlebot4' in fit
    assert 'car' not in fit
