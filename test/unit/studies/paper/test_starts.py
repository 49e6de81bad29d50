"""The paper's starts, driven by the law as it is by default."""

import pytest
from typer.testing import CliRunner

from cmpsp_ros.cli import app
from cmpsp_ros.studies.paper.starts import drive_start, starts

STARTS = starts()

pytestmark = pytest.mark.slow


@pytest.mark.parametrize('given', STARTS, ids=lambda each: each.label)
def test_every_start_arrives_at_little_more_than_the_least_cost(given):
    """Cost of the path taken; at most 15 % off wherever the law chooses its guesses."""
    path, optimum = drive_start(given, compare=True)
    assert path.miss < 1e-6
    assert path.clearance(between_samples=True).min() >= 0.0
    assert 1.0 - 1e-4 <= path.cost / optimum <= 1.15


def test_the_command_prints_them_all():
    plain = {'NO_COLOR': '1', 'COLUMNS': '200', 'TERM': 'dumb'}
    result = CliRunner().invoke(app, ['paper', '--starts'], env=plain)
    assert result.exit_code == 0, result.output
    rows = [line for line in result.stdout.splitlines() if '│ 51 ' in line or '│ 45 ' in line]
    assert len(rows) == len(STARTS) == 22
