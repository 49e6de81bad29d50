"""Measurements: presets, robots, plans, obstacles, sensors, people."""

import re
from itertools import islice

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks import crowds
from benchmarks.common import BenchError, Spread
from benchmarks.crowds import measure_plans
from benchmarks.drives import chosen
from benchmarks.general import SIZES, program
from benchmarks.people_tracks import COLUMNS, crowd, judged, row, static_room
from cmpsp_ros.cli import app
from cmpsp_ros.mpsp.qp import solve_qp
from cmpsp_ros.parameters.files import preset_names


def test_without_names_it_is_all_presets_and_the_runs_of_the_tables():
    found = {each.name: each for each in chosen(())}
    assert len(found) == len(preset_names()) + 4 + 3
    assert {'case1', 'case2', 'case3', 'case3_45'} < found.keys()
    assert found['table1_3, guess (18, 15)'].settings.initial_guess.wheel_speeds == (18.0, 15.0)
    assert found['table2_1, heading 60°'].pose == pytest.approx([0.0, -9.25, np.pi / 3.0])
    assert [each.name for each in chosen(['case2'])] == ['case2']


def test_more_plans_than_there_are_ways_is_an_error():
    # Past four obstacles there are sixteen.
    with pytest.raises(BenchError, match='wanted the best of 17 plans'):
        measure_plans(0, (17,))


@pytest.mark.slow
def test_the_command_for_obstacles():
    done = CliRunner().invoke(app, ['bench', '--obstacles', '--runs', '1'], env={'COLUMNS': '120'})
    assert done.exit_code == 0, done.output
    assert 'standing [us]' in done.stdout
    counts = re.findall(r'^\W*(\d+)\W+\d', done.stdout, re.MULTILINE)
    assert list(map(int, counts)) == list(crowds.OBSTACLE_COUNTS)


@pytest.fixture(scope='module')
def seen():
    return crowds.measure_sensors(1, ['unknown', crowds.FIELDS])


def test_every_part_of_a_run_is_timed(seen):
    unknown, fields = seen
    assert (unknown.name, fields.name) == ('unknown', crowds.FIELDS)
    assert 0.0 < fields.search.median < fields.after.largest
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


@pytest.mark.parametrize(
    ('count', 'p99', 'p999'), [(99, 0, 0), (100, 1, 0), (999, 1, 0), (1000, 1, 1)]
)
def test_percentiles_need_enough_values(count, p99, p999):
    spread = Spread.of(np.ones(count))
    assert (spread.p99 is not None, spread.p999 is not None) == (p99, p999)
