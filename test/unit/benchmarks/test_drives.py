"""Whole runs of the guidance law: presets, robots on long horizons."""

import numpy as np
import pytest

from benchmarks.drives import Preset, chosen, of_models, of_robots, time_presets, time_robots
from cmpsp_ros.guidance.planning import Planner
from cmpsp_ros.parameters.files import preset_names


def test_every_step_of_every_run_is_timed():
    told = []
    presets = [Preset.load('case1'), Preset.load('case3')]
    timings = time_presets(presets, 2, lambda: told.append(1))
    assert [each.name for each in timings] == ['case1', 'case3']
    assert len(told) == 4
    for each in timings:
        assert (each.first.count, each.every.count) == (2, 100)
        assert 0.0 < each.every.median <= each.every.p99 <= each.every.largest


def test_without_names_it_is_all_presets_and_the_runs_of_the_tables():
    found = {each.name: each for each in chosen(())}
    assert len(found) == len(preset_names()) + 4 + 3
    assert {'case1', 'case2', 'case3', 'case3_45'} < found.keys()
    assert found['table1_3, guess (18, 15)'].settings.initial_guess.wheel_speeds == (18.0, 15.0)
    assert found['table2_1, heading 60°'].pose == pytest.approx([0.0, -9.25, np.pi / 3.0])
    assert [each.name for each in chosen(['case2'])] == ['case2']


def test_a_robot_drives_to_the_goal():
    told, improve = [], Planner.improve
    (found,) = time_robots(of_robots(['jackal']), 2, lambda: told.append(1))
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
    for found in time_robots(of_models(), 1):
        assert found.times.shape == (1, 50)
        assert found.levels == {'nominal': 50}
        assert found.terminal_error < 1e-3
