"""Steps with many plans, past many obstacles, and with a scanner."""

import pytest
from typer.testing import CliRunner

from benchmarks import crowds
from benchmarks.common import BenchError
from benchmarks.crowds import measure_plans
from cmpsp_ros.cli import app


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
