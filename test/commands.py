"""The `cmpsp` command in this process, its output plain and wide."""

import inspect

from typer.testing import CliRunner, Result

from cmpsp_ros.cli import app

PLAIN = {'NO_COLOR': '1', 'COLUMNS': '200', 'TERM': 'dumb', 'TERMINAL_WIDTH': '200'}
# click 8.1 has either a separate standard error or all of the output; later ones have both
_KNOWN = inspect.signature(CliRunner).parameters
_SEPARATE = {'mix_stderr': False} if 'mix_stderr' in _KNOWN else {}


class _Both(Result):
    """The result of click 8.1, with the output of later ones."""

    @property
    def output(self):
        return self.stdout + self.stderr


def command(*arguments):
    result = CliRunner(**_SEPARATE).invoke(app, [str(each) for each in arguments], env=PLAIN)
    if _SEPARATE:
        result.__class__ = _Both
    return result
