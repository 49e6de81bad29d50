"""Output of commands: results to standard output, errors in red to standard error."""

from __future__ import annotations

from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console
    from rich.progress import Progress


@cache
def console() -> Console:
    """Standard output."""
    return _console(stderr=False)


@cache
def errors() -> Console:
    """Standard error."""
    return _console(stderr=True)


def progress_bar() -> Progress:
    """Bars on standard error, for work whose pieces are counted."""
    from rich.progress import Progress  # noqa: PLC0415 (`--help` is quicker without)

    return Progress(console=errors())


def complain(problem: object) -> None:
    """Say what is wrong, as it is: paths and messages are neither markup nor wrapped."""
    errors().print(str(problem), style='red', markup=False, highlight=False, soft_wrap=True)


def say(text: object) -> None:
    """Say what was found or written, as it is."""
    console().print(str(text), markup=False, highlight=False, soft_wrap=True)


@contextmanager
def exit_on(*kinds: type[Exception], code: int) -> Iterator[None]:
    """Turn errors that a user can mend into their message and an exit code.

    Args:
        kinds: Classes of these errors; any other is a fault of ours and keeps its traceback.
        code: The exit code.

    Raises:
        Exit: There was such an error.
    """
    try:
        yield
    except kinds as error:
        complain(error)
        raise typer.Exit(code) from None


def _console(*, stderr: bool) -> Console:
    from rich.console import Console  # noqa: PLC0415 (`--help` is quicker without)

    return Console(stderr=stderr)
