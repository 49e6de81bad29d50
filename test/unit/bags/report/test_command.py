"""`cmpsp report`: exit codes and words."""

from __future__ import annotations

from typer.testing import CliRunner

from cmpsp_ros.cli import app

PLAIN = {'NO_COLOR': '1', 'COLUMNS': '200', 'TERM': 'dumb', 'TERMINAL_WIDTH': '200'}


def invoke(*args):
    return CliRunner().invoke(app, ['report', *map(str, args)], env=PLAIN)


def test_it_says_what_it_wrote(drive, tmp_path):
    bag, output = drive.write(tmp_path / 'bag'), tmp_path / 'drive.html'
    done = invoke(bag, bag, '--output', output)
    assert done.exit_code == 0, done.output
    assert f'{output}: written' in done.output
    assert f'{output.with_suffix(".png")}: written' in done.output
    again = invoke(bag, '--output', output)
    assert again.exit_code == 2
    assert '--force replaces it' in again.stderr
    assert invoke(bag, '--output', output, '--force').exit_code == 0


def test_a_bag_that_cannot_be_used_is_exit_code_2(tmp_path):
    done = invoke(tmp_path / 'nothing', '--output', tmp_path / 'report.html')
    assert done.exit_code == 2
    assert 'no such bag' in done.stderr
    assert not (tmp_path / 'report.html').exists()
