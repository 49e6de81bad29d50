"""The `cmpsp` command: arguments in, exit code out.

A command is a function in a module of this folder; its signature and docstring are its options and
its help. The modules that do the work are imported when it is called, because `--help` must be
fast.
"""

import gc
from typing import Any, Final, get_type_hints

import typer
import typer.core

from cmpsp_ros.cli import bags, demo, live, studies
from cmpsp_ros.cli.terminal import console, errors, exit_on, progress_bar
from cmpsp_ros.programs import quick_exit

_OBJECTS_BEFORE_COLLECTION: Final = 100_000

# Plain help: rich, which draws boxes, takes longer to import than all the rest. In typer 0.9 no
# markup mode is without them.
vars(typer.core)['rich'] = None


class _Commands(typer.core.TyperGroup):
    """Commands in the order in which they were added, which typer 0.9 sorts; none is an error."""

    # typer may bring a click of its own
    def parse_args(self, context: Any, args: list[str]) -> list[str]:
        # click before 8.2 exits with 0 then
        if not args:
            typer.echo(context.get_help(), err=True)
            context.exit(2)
        return super().parse_args(context, args)

    def list_commands(self, _context: object) -> list[str]:
        return list(self.commands)


app = typer.Typer(
    cls=_Commands,
    help='Guidance of wheeled robots by C-MPSP.',
    rich_markup_mode=None,
    add_completion=False,
    pretty_exceptions_enable=False,
)
# In the order of `cmpsp --help`.
for _command in (
    demo.demo,
    bags.audit,
    studies.bench,
    studies.paper,
    studies.study,
    bags.export,
    bags.film,
    live.identify,
    live.record,
    live.recover,
    bags.replay,
    bags.report,
    live.play,
    live.view,
    studies.warmup,
):
    # The benchmarks have options of their own.
    passes_on = _command is studies.bench
    # typer 0.9 overlooks options in annotations that are strings
    _command.__annotations__ = get_type_hints(_command, include_extras=True)
    app.command(
        add_help_option=not passes_on,
        context_settings={'allow_extra_args': passes_on, 'ignore_unknown_options': passes_on},
    )(_command)


def main() -> None:
    """Entry point of the command."""
    # Importing makes many objects that stay: looking through them again and again takes a tenth of
    # the time that a short command needs.
    gc.set_threshold(_OBJECTS_BEFORE_COLLECTION)
    try:
        app()
    except SystemExit as end:
        if isinstance(end.code, int):
            quick_exit(end.code)
        raise
