"""Control steps of presets through the guidance law."""

import numpy as np
import pytest

from benchmarks.families.presets import Preset, chosen, measure
from cmpsp_ros.parameters import ParameterError
from cmpsp_ros.parameters.files import preset_names


def test_every_step_of_every_run_is_timed():
    told = []
    presets = [Preset.load('case1'), Preset.load('case3')]
    timings = measure(presets, 2, lambda: told.append(1))
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


def test_a_file_will_do(tmp_path):
    path = tmp_path / 'other.yaml'
    path.write_text('/**:\n  ros__parameters:\n    initial_pose: [0.0, -10.0, 0.1]\n')
    assert Preset.load(str(path)).pose.tolist() == [0.0, -10.0, 0.1]


def test_a_start_beside_the_road(tmp_path):
    path = tmp_path / 'beside.yaml'
    path.write_text('/**:\n  ros__parameters:\n    initial_pose: [0.0, -20.0, 0.0]\n')
    with pytest.raises(ParameterError, match='initial_pose'):
        Preset.load(str(path))


def test_unknown_preset():
    with pytest.raises(ParameterError, match=r'did you mean case3\?'):
        Preset.load('cas3')
