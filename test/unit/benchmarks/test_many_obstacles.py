"""The time of control steps past many obstacles: what is driven, and what is said of it."""

import math

import pytest
from typer.testing import CliRunner

from benchmarks.families import many_obstacles
from cmpsp_ros.cli import app

RUNS = 1


@pytest.fixture(scope='module')
def found():
    return many_obstacles.measure(RUNS, counts=(0, 2, 64))


def test_every_number_is_timed(found):
    assert [each.count for each in found] == [0, 2, 64]
    assert all(each.standing > 0.0 and each.moving > 0.0 and each.first > 0.0 for each in found)


def test_time_grows_no_worse_than_linearly(found):
    _, two, many = found
    assert many.standing < 32.0 * two.standing
    assert many.moving < 32.0 * two.moving


def test_they_move_along_the_road():
    now, later = (many_obstacles.tracks_of_some(4, stamp) for stamp in (0, 1_000_000_000))
    for one, other in zip(now, later, strict=True):
        assert math.hypot(one.x, one.y) == pytest.approx(math.hypot(other.x, other.y))
        assert math.dist((one.x, one.y), (other.x, other.y)) == pytest.approx(0.1, abs=1e-3)
        assert math.hypot(one.vx, one.vy) == pytest.approx(0.1)


def test_the_command(monkeypatch):
    monkeypatch.setattr(many_obstacles.measure, '__defaults__', ((0, 1), lambda: None))
    done = CliRunner().invoke(app, ['bench', '--obstacles', '--runs', '1'], env={'COLUMNS': '120'})
    assert done.exit_code == 0, done.output
    assert 'standing [us]' in done.stdout
    assert 'ratio' in done.stdout
