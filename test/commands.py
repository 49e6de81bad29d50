"""The `cmpsp` command in this process, its output plain and wide."""

from __future__ import annotations

from typer.testing import CliRunner

from cmpsp_ros.cli import app

PLAIN = {'NO_COLOR': '1', 'COLUMNS': '200', 'TERM': 'dumb', 'TERMINAL_WIDTH': '200'}


def command(*arguments):
    return CliRunner().invoke(app, [str(each) for each in arguments], env=PLAIN)
