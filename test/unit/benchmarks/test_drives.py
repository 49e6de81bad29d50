"""Whole runs of the guidance law: presets, robots on long horizons."""

from itertools import islice

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks import crowds
from benchmarks.common import BenchError, Spread, resident
from benchmarks.crowds import measure_plans
from benchmarks.drives import Preset, chosen, of_models, of_robots, time_presets, time_robots
from benchmarks.general import SIZES, program
from benchmarks.people_tracks import COLUMNS, crowd, judged, row, static_room
from cmpsp_ros.cli import app
from cmpsp_ros.guidance.planning import Planner
from cmpsp_ros.mpsp.qp import solve_qp
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


def test_as_many_plans_as_asked_in_both_steps():
    told = []
    found = measure_plans(2, (1, 4, 8), lambda: told.append(1))
    assert [each.count for each in found] == [1, 4, 8]
    assert len(told) == 9
    for each in found:
        assert each.first.shape == each.second.shape == (2,)
        assert (each.first > 0.0).all()
        assert (each.second > 0.0).all()


def test_more_plans_than_there_are_ways_is_an_error():
    # Past four obstacles there are sixteen.
    with pytest.raises(BenchError, match='wanted the best of 17 plans'):
        measure_plans(0, (17,))


RUNS = 1


@pytest.fixture(scope='module')
def found():
    return crowds.measure_obstacles(RUNS, counts=(0, 2, 64))


def test_the_command_for_obstacles(monkeypatch):
    monkeypatch.setattr(crowds.measure_obstacles, '__defaults__', ((0, 1), lambda: None))
    done = CliRunner().invoke(app, ['bench', '--obstacles', '--runs', '1'], env={'COLUMNS': '120'})
    assert done.exit_code == 0, done.output
    assert 'standing [us]' in done.stdout
    assert 'ratio' in done.stdout


@pytest.fixture(scope='module')
def seen():
    return crowds.measure_sensors(1, ['unknown'])


def test_every_part_of_a_run_is_timed(seen):
    (unknown,) = seen
    assert unknown.name == 'unknown'
    assert unknown.cells == 200 * 200
    assert unknown.step.count == unknown.field.count == unknown.search.count == 28 * 5
    assert 0.0 < unknown.field.median < unknown.step.median


@pytest.mark.parametrize('size', SIZES)
def test_programs_are_solvable_and_have_active_rows(size):
    found = program(1, *size)
    assert (found.size.state, found.size.control) == size
    ours, other = (solve_qp(found, name) for name in ('riccati_active_set', 'daqp'))
    np.testing.assert_allclose(ours.dU, other.dU, atol=1e-7)
    assert np.count_nonzero(ours.bounds) > 0
    assert np.count_nonzero(ours.path) > 0


def test_people_are_tracked_where_they_walk():
    score = judged(islice(crowd('hall', 4, (0.0, 0.0), 0.0), 200))
    assert score.visible > 300
    assert score.covered > 0.9 * score.visible
    place, velocity, *_ = np.median(score.errors, axis=0)
    assert place < 0.03
    assert velocity < 0.15
    assert score.false == 0
    assert len(row(score)) == len(COLUMNS) - 4


def test_nobody_is_tracked_in_a_room_without_people():
    score = judged(islice(static_room(0, 0.3), 200))
    assert score.scans == 200
    assert score.identities == 0


def test_known_sample():
    spread = Spread.of(np.arange(1001.0).reshape(7, 143))
    assert (spread.count, spread.median, spread.largest) == (1001, 500.0, 1000.0)
    assert spread.p99 == pytest.approx(990.0)
    assert spread.p999 == pytest.approx(999.0)


@pytest.mark.parametrize(
    ('count', 'p99', 'p999'), [(99, 0, 0), (100, 1, 0), (999, 1, 0), (1000, 1, 1)]
)
def test_percentiles_need_enough_values(count, p99, p999):
    spread = Spread.of(np.ones(count))
    assert (spread.p99 is not None, spread.p999 is not None) == (p99, p999)


def test_of_this_process_it_is_that_of_what_it_holds():
    before = resident()
    held = bytearray(b'x' * 100_000_000)
    grown = resident() - before
    assert len(held) == 100_000_000
    assert 50.0 < grown < 300.0
