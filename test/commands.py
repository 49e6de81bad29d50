"""The `cmpsp` command in this process, its output plain and wide."""

from __future__ import annotations

import inspect

from typer.testing import CliRunner

from cmpsp_ros.cli import app

PLAIN = {'NO_COLOR': '1', 'COLUMNS': '200', 'TERM': 'dumb', 'TERMINAL_WIDTH': '200'}
# click 8.1 mixes both outputs unless told not to; later ones cannot
_KNOWN = inspect.signature(CliRunner).parameters
_SEPARATE = {'mix_stderr': False} if 'mix_stderr' in _KNOWN else {}


def command(*arguments):
    return CliRunner(**_SEPARATE).invoke(app, [str(each) for each in arguments], env=PLAIN)
