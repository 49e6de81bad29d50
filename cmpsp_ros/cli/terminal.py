"""Options of several commands; results to standard output, errors in red to standard error."""

from __future__ import annotations

import errno
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Annotated, Optional

import typer

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from rich.console import Console
    from rich.progress import Progress

Assignments = Annotated[
    Optional[list[str]],
    typer.Option('--set', metavar='KEY=VALUE', help='Change a parameter; may be repeated.'),
]
Odom = Annotated[
    Optional[str], typer.Option(metavar='TOPIC', help='Odometry; <namespace>/odom when absent.')
]
CmdVel = Annotated[
    Optional[str], typer.Option(metavar='TOPIC', help='Commands; <namespace>/cmd_vel when absent.')
]
Namespace = Annotated[Optional[str], typer.Option(help='Namespace of the node, as in /r1.')]
ParamsFile = Annotated[
    Optional[str],
    typer.Option(metavar='FILE', help='Parameters, or a preset, in place of those in the bag.'),
]


@cache
def console(*, stderr: bool = False) -> Console:
    """Standard output, or standard error."""
    from rich.console import Console  # noqa: PLC0415 (`--help` is quicker without)

    return Console(stderr=stderr)


def errors() -> Console:
    """Standard error."""
    return console(stderr=True)


def progress_bar() -> Progress:
    """Progress bar on standard error, for a known number of steps."""
    from rich.progress import Progress  # noqa: PLC0415 (`--help` is quicker without)

    return Progress(console=errors())


def complain(problem: object) -> None:
    """Print an error verbatim: paths and messages are neither markup nor wrapped."""
    errors().print(str(problem), style='red', markup=False, highlight=False, soft_wrap=True)


def remark(text: object) -> None:
    """Print a remark verbatim on standard error."""
    errors().print(str(text), markup=False, highlight=False, soft_wrap=True)


def say(text: object) -> None:
    """Print a result verbatim."""
    console().print(str(text), markup=False, highlight=False, soft_wrap=True)


@contextmanager
def exit_on(*kinds: type[Exception], code: int) -> Iterator[None]:
    """Turn errors that a user can fix into their message and an exit code."""
    try:
        yield
    except kinds as error:
        complain(error)
        raise typer.Exit(code) from None


@contextmanager
def writing_to(folder: Path) -> Iterator[None]:
    """Turn a full disk into a message with the name of a folder on it, and exit code 1."""
    try:
        yield
    except OSError as error:
        if error.errno not in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
            raise
        complain(f'{error.filename or folder}: cannot be written: {error.strerror}')
        raise typer.Exit(1) from None
