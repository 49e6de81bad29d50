"""The time of control steps with a scanner: what is driven, and what is said of it."""

import pytest
from typer.testing import CliRunner

from benchmarks.families import sensors
from cmpsp_ros.cli import app


@pytest.fixture(scope='module')
def found():
    return sensors.measure(1, ['unknown'])


def test_every_part_of_a_run_is_timed(found):
    (unknown,) = found
    assert unknown.name == 'unknown'
    assert unknown.cells == 200 * 200
    assert unknown.step.count == unknown.field.count == unknown.search.count == 28 * 5
    assert 0.0 < unknown.field.median < unknown.step.median


def test_the_command(monkeypatch, found):
    monkeypatch.setattr(sensors, 'measure', lambda _: found)
    done = CliRunner().invoke(app, ['bench', '--sensors'], env={'COLUMNS': '120'})
    assert done.exit_code == 0, done.output
    assert 'unknown' in done.stdout
    assert '40000' in done.stdout
